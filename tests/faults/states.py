"""In which state a car ended, and since when: from the bag alone.

Every 50 ms from the beginning of the fault to the end of the run the car is in one state:

    stopped   slower than 0.3 m/s: a car that stops rocks on its tyres
    braking   the controller is on its last rung, or the car loses more than 2 m/s^2 of speed
    degraded  the plan followed is not that of the present tick, or nobody says which it is
    OK        otherwise

The last one is the state in which the run ended; it counts from when it was kept.
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
LATEST_NS = 300_000_000  # age of the last word of the controller
STANDSTILL_MPS = 0.3
BRAKING_MPS2 = 2.0
HEARTBEAT_NS = 3_000_000_000  # of Fast DDS
OVER_NS = 100_000_000  # for the deceleration
COMMAND, ACTUATORS = '/controller/command', '/vehicle/actuators'
PLANNED = ('solved', 'stopped_early', 'second_solver')
# refusals of the plant's gate that a sound controller never causes
NONSENSE = ('not_finite', 'out_of_range', 'too_fast', 'beyond_friction', 'unreadable')


class Ending(NamedTuple):
    """How a run ended."""

    state: str
    settled_s: float  # from the beginning of the fault until the state was kept
    visited: tuple[str, ...]  # the states in their order
    before: str  # what was not OK in the second before the fault, '' when all was


class Motion(NamedTuple):
    """What was recorded of the car: n messages."""

    log_ns: np.ndarray
    stamp_ns: np.ndarray
    speed: np.ndarray  # m/s


def sound(bag: Bag, topic: str, decoder) -> list:
    """Return (instant [ns], value) of every message of a topic that can be read."""
    found = []
    recording = bag.recordings.get(topic)
    if recording is None:
        return found
    instants = map(_instant, recording.log_ns.tolist(), recording.publish_ns.tolist())
    for instant_ns, payload in zip(instants, recording.payloads):
        try:
            message = cdr.decode(payload, recording.topic.schema, recording.topic.type)
            found.append((instant_ns, decoder(message)))
        except (BagError, decode.DecodeError):
            continue
    return found


def _instant(log_ns, sent_ns):
    """Return when a message was sent, where sender and recorder have one clock, else its log time.

    A message that was lost on its way is sent again within a period of heartbeats: being told late
    is no state of the car. In lockstep log times are simulated, and a clock may have jumped.
    """
    return sent_ns if 0 <= log_ns - sent_ns <= HEARTBEAT_NS else log_ns


def motion(bag: Bag) -> Motion:
    """Return the motion of the car."""
    states = sound(bag, '/vehicle/odometry', decode.odometry)
    log_ns = np.array([log for log, _ in states], dtype=np.int64)
    stamp_ns = np.array([x.stamp_ns for _, x in states], dtype=np.int64)
    return Motion(log_ns, stamp_ns, np.array([np.hypot(x.vx, x.vy) for _, x in states]))


def ending(bag: Bag, begins_ns: int, plant_lives: bool) -> Ending:
    """Return how a run ended; `plant_lives`: it ends with the last state, else with the last word.

    Log times are those of the recorder: simulated time in lockstep, else wall time.
    """
    car = motion(bag)
    words = sound(bag, '/controller/why', decode.why)
    said_ns = np.array([log for log, _ in words], dtype=np.int64)
    told = [f'{why.values["rung"]}: {why.values["reason"]}' for _, why in words]
    rungs = [why.values['rung'] for _, why in words]
    end_ns = int(car.log_ns[-1] if plant_lives else said_ns[-1])
    if begins_ns > end_ns:
        raise BagError(f'the fault begins {(begins_ns - end_ns) / 1e9:.3f} s after the end')

    def between(first_ns, last_ns):
        instants = np.arange(last_ns, first_ns - 1, -GRID_NS)[::-1]
        return instants, [_at(now, car, said_ns, rungs, plant_lives) for now in instants.tolist()]

    instants, states = between(begins_ns, end_ns)
    # what holds at the instant of the fault is the first thing that came of it
    earlier, before = between(max(begins_ns - BEFORE_NS, int(said_ns[0])), begins_ns - 1)
    kept = len(states) - 1
    while kept and states[kept - 1] == states[-1]:
        kept -= 1
    changes = [states[0], *(b for a, b in pairwise(states) if a != b)]
    settled_ns = instants[kept] - begins_ns if kept else 0
    wrong = [_blame(*one, said_ns, told) for one in zip(earlier, before) if one[1] != 'OK']
    return Ending(states[-1], settled_ns / 1e9, tuple(changes), '; '.join(dict.fromkeys(wrong)))


def _blame(now_ns, state, said_ns, told):
    """Return a state with what was said of it."""
    last = np.searchsorted(said_ns, now_ns, side='right') - 1
    is_said = now_ns - said_ns[last] <= LATEST_NS
    return f'{state} ({told[last] if is_said else "not a word"})'


def _at(now_ns, car, said_ns, rungs, plant_lives):
    heard = np.searchsorted(car.log_ns, now_ns, side='right') - 1
    speed = car.speed[heard]
    if speed < STANDSTILL_MPS:
        return 'stopped'
    last = np.searchsorted(said_ns, now_ns, side='right') - 1
    rung = rungs[last] if last >= 0 and now_ns - said_ns[last] <= LATEST_NS else None
    if rung == 'braking' or (plant_lives and _deceleration(car, heard) > BRAKING_MPS2):
        return 'braking'
    return 'OK' if rung in PLANNED else 'degraded'


def _deceleration(car, heard):
    """Return the loss of speed [m/s^2] over the time before a state; 0 where it is not known."""
    before = np.searchsorted(car.stamp_ns, car.stamp_ns[heard] - OVER_NS)
    elapsed_s = (car.stamp_ns[heard] - car.stamp_ns[before]) / 1e9
    if before >= heard or elapsed_s > 2 * OVER_NS / 1e9:
        return 0.0
    return (car.speed[before] - car.speed[heard]) / elapsed_s


def nonsense(bag: Bag, harmed: Iterable[str]) -> int:
    """Return how many commands were sent, or let through, that must not be.

    Counted are commands of the controller and positions of the actuators that break the contract,
    and what the plant's gate refused. Of the `harmed` topics nothing is counted: the telemetry was
    harmed before it was recorded, the commands on their way to the gate, after they were recorded.
    """
    count = 0 if COMMAND in harmed else refused(bag)
    for topic in {COMMAND, ACTUATORS} - (set(harmed) - {COMMAND}):
        recording = bag.recordings[topic]
        for payload in recording.payloads:
            try:
                message = cdr.decode(payload, recording.topic.schema, recording.topic.type)
            except BagError:
                count += 1
                continue
            count += bool(conformance.check(topic, message))
    return count


def refused(bag: Bag) -> int:
    """Return how many commands the plant's gate refused for what they asked."""
    health = [h for _, h in sound(bag, '/diagnostics', decode.health) if h.name == 'plant']
    counts = [sum(int(h.values.get(f'rejected.{code}', 0)) for code in NONSENSE) for h in health]
    return max(counts, default=0)
