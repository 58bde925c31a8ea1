"""The state in which a car ended, and since when, from the bag alone.

Every 50 ms from the fault to the end of the run the car is in one state:

    stopped   slower than 0.3 m/s: a car that stops rocks on its tyres
    braking   the controller is on its last fallback level, or the car decelerates by 2 m/s^2
    degraded  the plan followed is not that of the present tick, or no report says which it is
    OK        otherwise

The last one is the final state; it is settled when no other state follows it.
"""

from collections.abc import Iterable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from bags.errors import BagError
from bags.storage import cdr
from bags.storage.read import Bag
from msgs_yaml import conformance, decode

GRID_NS = 50_000_000
BEFORE_NS = 1_000_000_000
MAX_REPORT_AGE_NS = 300_000_000  # of the controller
STANDSTILL_MPS = 0.3
BRAKING_MPS2 = 2.0
HEARTBEAT_NS = 3_000_000_000  # of Fast DDS
DECELERATION_WINDOW_NS = 100_000_000
COMMAND, ACTUATORS = '/controller/command', '/vehicle/actuators'
PLANNED = ('solved', 'stopped_early')
# rejections of the plant's gate that a correct controller never causes
INVALID_COMMAND_CODES = ('not_finite', 'out_of_range', 'too_fast', 'beyond_friction', 'unreadable')


class FinalState(NamedTuple):
    """The final state of a run and the states before it."""

    state: str
    settled_s: float  # from the fault until the final state was kept
    visited: tuple[str, ...]  # all states in their order
    before: str  # states that were not OK in the second before the fault, with reasons; '': none


class Motion(NamedTuple):
    """The recorded motion of the car, n samples."""

    log_ns: np.ndarray
    stamp_ns: np.ndarray
    speed: np.ndarray  # m/s


def readable_messages(bag: Bag, topic: str, decoder) -> list:
    """Return (instant [ns], value) of every readable message of a topic."""
    values = []
    recording = bag.recordings.get(topic)
    if recording is None:
        return values
    instants = map(_instant, recording.log_ns.tolist(), recording.publish_ns.tolist())
    for instant_ns, payload in zip(instants, recording.payloads):
        try:
            message = cdr.decode(payload, recording.topic.schema, recording.topic.type)
            values.append((instant_ns, decoder(message)))
        except (BagError, decode.DecodeError):
            continue
    return values


def _instant(log_ns, sent_ns):
    """Return when a message was sent where sender and recorder share a clock, else its log time.

    DDS sends a lost message again within a heartbeat period, and this delay says nothing about the
    car. In lockstep log times are simulated, and a clock may have jumped.
    """
    return sent_ns if 0 <= log_ns - sent_ns <= HEARTBEAT_NS else log_ns


def motion(bag: Bag) -> Motion:
    """Return the motion of the car."""
    states = readable_messages(bag, '/vehicle/odometry', decode.odometry)
    log_ns = np.array([log for log, _ in states], dtype=np.int64)
    stamp_ns = np.array([x.stamp_ns for _, x in states], dtype=np.int64)
    return Motion(log_ns, stamp_ns, np.array([np.hypot(x.vx, x.vy) for _, x in states]))


def final_state(bag: Bag, begins_ns: int, plant_lives: bool) -> FinalState:
    """Return the final state.

    The run ends with the last odometry where `plant_lives`, else with the controller's last report.

    Log times are those of the recorder: simulated time in lockstep, else wall time.
    """
    car = motion(bag)
    reports = readable_messages(bag, '/controller/why', decode.why)
    report_ns = np.array([log for log, _ in reports], dtype=np.int64)
    reasons = [f'{why.values["rung"]}: {why.values["reason"]}' for _, why in reports]
    levels = [why.values['rung'] for _, why in reports]
    end_ns = int(car.log_ns[-1] if plant_lives else report_ns[-1])
    if begins_ns > end_ns:
        raise BagError(f'the fault begins {(begins_ns - end_ns) / 1e9:.3f} s after the end')

    def between(first_ns, last_ns):
        instants = np.arange(last_ns, first_ns - 1, -GRID_NS)[::-1]
        return instants, [
            _state_at(now, car, report_ns, levels, plant_lives) for now in instants.tolist()
        ]

    instants, states = between(begins_ns, end_ns)
    # the state at the instant of the fault is already an effect of the fault
    earlier, before = between(max(begins_ns - BEFORE_NS, int(report_ns[0])), begins_ns - 1)
    kept = len(states) - 1
    while kept and states[kept - 1] == states[-1]:
        kept -= 1
    changes = [states[0], *(b for a, b in pairwise(states) if a != b)]
    settled_ns = instants[kept] - begins_ns if kept else 0
    wrong = [
        _state_with_reason(*one, report_ns, reasons)
        for one in zip(earlier, before)
        if one[1] != 'OK'
    ]
    return FinalState(states[-1], settled_ns / 1e9, tuple(changes), '; '.join(dict.fromkeys(wrong)))


def _state_with_reason(now_ns, state, report_ns, reasons):
    """Return a state with the reason that the controller reported."""
    last = np.searchsorted(report_ns, now_ns, side='right') - 1
    is_recent = now_ns - report_ns[last] <= MAX_REPORT_AGE_NS
    return f'{state} ({reasons[last] if is_recent else "no report"})'


def _state_at(now_ns, car, report_ns, levels, plant_lives):
    sample = np.searchsorted(car.log_ns, now_ns, side='right') - 1
    speed = car.speed[sample]
    if speed < STANDSTILL_MPS:
        return 'stopped'
    last = np.searchsorted(report_ns, now_ns, side='right') - 1
    level = levels[last] if last >= 0 and now_ns - report_ns[last] <= MAX_REPORT_AGE_NS else None
    brakes = plant_lives and _deceleration(car, sample) > BRAKING_MPS2
    if level in ('recovery', 'braking') or brakes:
        return 'braking'
    return 'OK' if level in PLANNED else 'degraded'


def _deceleration(car, sample):
    """Return the deceleration [m/s^2] in the window before a sample; 0 where it is unknown."""
    before = np.searchsorted(car.stamp_ns, car.stamp_ns[sample] - DECELERATION_WINDOW_NS)
    elapsed_s = (car.stamp_ns[sample] - car.stamp_ns[before]) / 1e9
    if before >= sample or elapsed_s > 2 * DECELERATION_WINDOW_NS / 1e9:
        return 0.0
    return (car.speed[before] - car.speed[sample]) / elapsed_s


def count_invalid_commands(bag: Bag, damaged: Iterable[str]) -> int:
    """Return how many invalid commands were sent or accepted.

    Counts commands of the controller and positions of the actuators that violate the contract, and
    rejections by the plant's gate. `damaged` topics are not counted: telemetry is damaged before it
    is recorded, commands are damaged after that, on their way to the gate.
    """
    count = 0 if COMMAND in damaged else count_rejections(bag)
    for topic in {COMMAND, ACTUATORS} - (set(damaged) - {COMMAND}):
        recording = bag.recordings[topic]
        for payload in recording.payloads:
            try:
                message = cdr.decode(payload, recording.topic.schema, recording.topic.type)
            except BagError:
                count += 1
                continue
            count += bool(conformance.check(topic, message))
    return count


def count_rejections(bag: Bag) -> int:
    """Return how many commands the plant's gate rejected for their content."""
    health = [
        status
        for _, statuses in readable_messages(bag, '/diagnostics', decode.health)
        for status in statuses
        if status.name == 'plant'
    ]
    counts = [
        sum(int(h.values.get(f'rejected.{code}', 0)) for code in INVALID_COMMAND_CODES)
        for h in health
    ]
    return max(counts, default=0)
