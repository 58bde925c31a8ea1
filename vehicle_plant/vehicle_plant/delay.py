"""Pure delay of the set-points before the servos, in whole steps.

Set-points are straight lines between samples at the ends of the steps, so shifting the samples by n
of them delays the signal by exactly n steps: no chain of lags, whose answer begins too early, and
nothing to integrate.
"""

from typing import NamedTuple

import numpy as np

from vehicle_plant.state import SetPoints


class Delays(NamedTuple):
    """Steps by which each set-point comes late, in the order of `SetPoints`."""

    delta: int
    Fxf: int
    Fxr: int


def of(car) -> Delays:
    """Return the delays of a `car.Car`; a step is 1 ms."""
    return Delays(car.steering.delay_ms, car.force.front.delay_ms, car.force.rear.delay_ms)


class DelayLine:
    """The last samples of each set-point that comes late."""

    def __init__(self, delays: Delays, held: SetPoints):
        """Fill the line with what has been held so far."""
        self._lines = {
            i: np.full(n + 1, value) for i, (n, value) in enumerate(zip(delays, held)) if n
        }

    def take(self, set_points: np.ndarray) -> np.ndarray:
        """Return (n + 1, 3) set-points as they come out while these go in.

        The first row in is the last one of the call before.
        """
        late = np.array(set_points)
        for i, line in self._lines.items():
            samples = np.concatenate([line, set_points[1:, i]])
            late[:, i] = samples[: len(set_points)]
            self._lines[i] = samples[len(set_points) - 1 :]
        return late
