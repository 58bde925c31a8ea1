"""Estimates by how much set-points arrive late, from where the actuators were. SI units; ns.

An actuator is where the set-points of its lag earlier were, or those of its lag and a delay. The
delay that explains the last messages best is believed if it explains them much better than none.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving.delay_compensation import SetpointRamp, setpoints_at
from mpcc_controller.driving.setpoints import Setpoints
from msgs_yaml.conversions import NS_PER_S

DELAYS_NS = tuple(range(0, 350_000_000, 50_000_000))  # that are compared, beyond what is known
LATE_NS = 100_000_000  # no shorter one is believed: it may be one of the car that nobody told
COMPARED, REMEMBERED = 10, 20  # messages, a tick apart
APART_NS = 40_000_000  # at least
# in units: the least range of the differences from which delays are told apart; the share of their
# deviation that the delay leaves which explains it; the deviation from which none is believed
LEAST_RANGE, EXPLAINED, MOST_DEVIATION = 0.3, 0.3, 1.0


class Message(NamedTuple):
    """A message of the actuators, beside what they were asked for."""

    stamp_ns: int
    asked: Setpoints  # at that stamp, without a delay
    measured: Setpoints
    differences: tuple[float, float]  # from what is expected with the delay believed, in units


class DelayEstimate(NamedTuple):
    """What is known of the delay after a message, at first nothing."""

    late_ns: int = 0  # beyond what is known beforehand
    messages: tuple[Message, ...] = ()  # the last ones


class DelayEstimator:
    """Estimates one delay of all set-points."""

    def __init__(self, lags: Sequence[float], units: Sequence[float]):
        """`lags` [s] of steering and force; `units` (rad, N) in which both count alike."""
        self._lags_ns = [round(lag_s * NS_PER_S) for lag_s in lags]
        self._units = units

    def update(
        self,
        known: DelayEstimate,
        measured: Setpoints,
        ramps: Sequence[SetpointRamp],
        stamp_ns: int,
    ) -> DelayEstimate:
        """Return what is known after a message; `ramps` are those with the delay believed."""
        if known.messages and stamp_ns - known.messages[-1].stamp_ns < APART_NS:
            return known
        asked, _ = setpoints_at(ramps, stamp_ns + known.late_ns)
        differences = tuple(
            (measured[i] - setpoints_at(ramps, stamp_ns - lag_ns)[0][i]) / unit
            for i, (lag_ns, unit) in enumerate(zip(self._lags_ns, self._units))
        )
        message = Message(stamp_ns, asked, measured, differences)
        messages = (*known.messages, message)[-REMEMBERED:]
        return DelayEstimate(self._delay(messages, known.late_ns), messages)

    def _delay(self, messages, late_ns):
        """Return the delay [ns] that explains the messages, `late_ns` where none is better.

        What is off by an amount that stays is not late. The longest delay explains nothing: an
        actuator that does not move fits it best.
        """
        columns = [*zip(*(message.differences for message in messages[-COMPARED:]))]
        if max(max(column) - min(column) for column in columns) < LEAST_RANGE:
            return late_ns
        deviations = self._deviations(messages)
        now = deviations[DELAYS_NS.index(late_ns)]
        # while set-points stay delays explain them alike
        best = int(np.argmax(deviations <= 2.0 * min(deviations)))
        if deviations[best] < EXPLAINED * min(now, deviations[-1]):
            return DELAYS_NS[best] if DELAYS_NS[best] >= LATE_NS else 0
        return late_ns if now < max(MOST_DEVIATION, deviations[0]) else 0

    def _deviations(self, messages):
        """Return the standard deviation from what each delay expects, of both, in units, (7,)."""
        stamps_ns = np.array([message.stamp_ns for message in messages])
        squared = np.zeros(len(DELAYS_NS))
        for i, (lag_ns, unit) in enumerate(zip(self._lags_ns, self._units)):
            at_ns = np.subtract.outer(stamps_ns[-COMPARED:] - lag_ns, DELAYS_NS)
            expected = np.interp(at_ns, stamps_ns, [message.asked[i] for message in messages])
            measured = np.array([message.measured[i] for message in messages[-COMPARED:]])
            squared += np.var(measured[:, None] - expected, axis=0) / unit**2
        return np.sqrt(squared)
