"""Leave out the messages of a bag that break the contract, and say how many there were.

So it is with samples of the car whose stamp is of another time (`in_time`).

Nodes turn such a message down and go on, and so do the tools that read a recording: it may come
from a publisher that is none of ours, or from a car that did what the contract holds for
impossible.


Which of thousands of messages obey the contract, found from their numbers as arrays.

Faster than a decoder by two orders of magnitude, and never laxer: a message that is not in order
here is to be decoded, which decides and says why.


Which samples of a car have a stamp of another time than the messages around them.

Any stamp after 1970 obeys the contract, also that of a player or of a ring in simulated time which
publishes on the topics of a ring on the wall clock.
"""

from bisect import bisect_right
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from bags.errors import BagError
from bags.storage.columns import SOURCES
from bags.storage.decoding import (
    DECODE_ERRORS,
    DECODERS,
    _read_column,
    column,
    decode_message,
    group_by_layout,
    header_stamps_ns,
)
from bags.storage.message_filing import LOCKSTEP
from bags.storage.read import STATE, Bag, InvalidMessages, Recording
from bags.storage.rosbag2_metadata import BagTopic
from msgs_yaml import contract
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.decode import UNIT_TOLERANCE

KEY = 'invalid_messages'  # in JSON


class _Checked(NamedTuple):
    """The value of one message, or why it is invalid."""

    value: Any
    reason: str  # '' when it is valid


def drop_invalid(bag: Bag) -> Bag:
    """Return the bag without the messages that break the contract; `Bag.invalid` counts them.

    Samples of the car with a stamp of another time are left out likewise. In lockstep a second
    state of one stamp stays: it is that of a second ring, for which a reader may refuse the bag.
    Topics that the contract does not know stay as they are, and so does a bag that was sifted.
    """
    if bag.sifted:
        return bag
    recordings, decoded, invalid = dict(bag.recordings), {}, {}
    for name, recorded in bag.recordings.items():
        if name not in DECODERS or not recorded.payloads:
            continue
        values, reasons = _check(recorded)
        if name in VEHICLE_TOPICS:
            keep_twins = name == STATE and bag.run_info.get('mode') == LOCKSTEP
            reasons |= _foreign(recorded, reasons, keep_twins)
        if values is not None:
            decoded[name] = [values[i] for i in range(len(values)) if i not in reasons]
        if reasons:
            recordings[name] = _without(recorded, reasons)
            first = min(reasons)
            invalid[name] = InvalidMessages(len(reasons), f'message {first}: {reasons[first]}')
    return bag._replace(recordings=recordings, decoded=decoded, invalid=invalid, sifted=True)


def count_invalid(bag: Bag) -> dict[str, dict[str, dict[str, Any]]]:
    """Return {'invalid_messages': {topic: {count, first}}} of a sifted bag, {} without any."""
    found = {name: one._asdict() for name, one in bag.invalid.items()}
    return {KEY: found} if found else {}


def describe_invalid(found: Mapping[str, Any]) -> Iterator[str]:
    """Yield what `counts` has put into a dictionary, a line per topic."""
    for name, one in found.get(KEY, {}).items():
        yield f'{one["count"]} invalid messages of {name} were left out; {one["first"]}'


def _check(recorded) -> tuple[list[Any] | None, dict[int, str]]:
    """Return the values of all messages, None where not all were decoded, and what is wrong."""
    topic, payloads = recorded.topic, recorded.payloads
    in_order = obeys_contract(topic, payloads)
    known, reasons = {}, {}
    for i in np.flatnonzero(~in_order).tolist():
        payload = payloads[i]
        if payload not in known:
            known[payload] = _decode(topic, payload)
        if known[payload].reason:
            reasons[i] = known[payload].reason
    if in_order.any():
        return None, reasons
    return [known[payload].value for payload in payloads], reasons


def _foreign(recorded, reasons, keep_twins):
    """Return what is wrong with samples of another time among those that obey the contract."""
    rows = np.setdiff1d(np.arange(len(recorded.payloads)), list(reasons))
    if not rows.size:
        return {}
    stamp_ns = header_stamps_ns(recorded.topic.name, [recorded.payloads[row] for row in rows])
    found = find_foreign_stamps(stamp_ns, recorded.log_ns[rows], keep_twins)
    return {int(rows[k]): reason for k, reason in found}


def _decode(topic, payload):
    try:
        return _Checked(decode_message(topic, payload), '')
    except DECODE_ERRORS as error:
        return _Checked(None, str(error).removeprefix(f'{topic.name}: ') or type(error).__name__)


def _without(recorded: Recording, rows) -> Recording:
    kept = np.setdiff1d(np.arange(len(recorded.payloads)), list(rows))
    return Recording(
        recorded.topic,
        recorded.log_ns[kept],
        recorded.publish_ns[kept],
        recorded.sequence[kept],
        [recorded.payloads[i] for i in kept],
    )


ARRAYS = ('position', 'velocity', 'effort')
ORIENTATION = 'pose.pose.orientation'


def obeys_contract(topic: BagTopic, payloads: list[bytes]) -> np.ndarray:
    """Return for each message (n,) whether it certainly obeys the contract.

    None does of a topic that has no SOURCES, nor when one of them does not fit its definition.
    """
    obeys = np.zeros(len(payloads), dtype=bool)
    if topic.name not in SOURCES:
        return obeys
    known = contract.load().topics[topic.name]
    try:
        for group, bytes_, where in group_by_layout(payloads, topic.schema, topic.type):
            if _has_contract_form(known, where):
                obeys[group] = _has_contract_ranges(known, bytes_, where)
    except BagError:
        return np.zeros(len(payloads), dtype=bool)
    return obeys


def _has_contract_form(known, where):
    """Tell whether frames, joint names and array lengths are those of the contract."""
    texts = dict(where.strings)
    frames = {'header.frame_id': known.frame}
    if known.child_frame is not None:
        frames['child_frame_id'] = known.child_frame
    joints = {f'name[{i}]': joint for i, joint in enumerate(known.joints)}
    if any(texts.pop(path, None) != text for path, text in (frames | joints).items()):
        return False
    return not any(path.startswith('name[') for path in texts) and all(
        sum(path.startswith(f'{array}[') for path in where.numbers) == len(joints)
        for array in ARRAYS
        if joints
    )


def _has_contract_ranges(known, bytes_, where):
    sec, nanosec = (column(bytes_, where, f'header.stamp.{part}') for part in ('sec', 'nanosec'))
    found = (sec > 0) | (sec == 0) & (nanosec > 0)
    for path, field in known.fields.items():
        values = column(bytes_, where, path)
        found &= (values >= field.low) & (values <= field.high)
    # a JointState's unused places, too, must be finite
    for path in where.numbers if known.joints else ():
        if path.startswith(ARRAYS):
            found &= np.isfinite(_read_column(bytes_, where, path))
    if f'{ORIENTATION}.w' in where.numbers:
        parts = [column(bytes_, where, f'{ORIENTATION}.{axis}') for axis in 'xyzw']
        found &= np.abs(np.sum(np.square(parts), axis=0) - 1.0) <= UNIT_TOLERANCE
    return found


VEHICLE_TOPICS = ('/vehicle/odometry', '/vehicle/actuators', '/vehicle/imu', '/vehicle/wheels')
# How much later or earlier than usual a sample may be recorded: a plant that was stopped for
# minutes sends what it missed, and no other clock is as near by chance.
NEAR_NS = 600 * NS_PER_S


def find_foreign_stamps(
    stamp_ns: np.ndarray, log_ns: np.ndarray, keep_twins: bool = False
) -> Iterator[tuple[int, str]]:
    """Yield (row, what is wrong) of the samples of a topic with a stamp of another time.

    From stamp to log time it takes all samples of a topic about as long, in lockstep no time. Of
    those that are near, as few are foreign as can be while no stamp of the others falls back; with
    `keep_twins` only those whose stamp none of the others has.
    """
    took_ns = log_ns - stamp_ns
    off_ns = took_ns - np.median(took_ns)
    near = np.flatnonzero(np.abs(off_ns) <= NEAR_NS)
    for row in np.setdiff1d(np.arange(len(stamp_ns)), near).tolist():
        yield (
            row,
            f'header.stamp is {stamp_ns[row] / NS_PER_S:.3f} s, '
            f'{abs(off_ns[row]) / NS_PER_S:.0f} s from the stamps that were recorded about then; '
            f'allowed up to {NEAR_NS / NS_PER_S:.0f} s',
        )
    if np.all(np.diff(stamp_ns[near]) >= 0):
        return
    kept = near[_longest_ordered(stamp_ns[near].tolist())]
    if keep_twins:
        kept = near[np.isin(stamp_ns[near], stamp_ns[kept])]
    for row in np.setdiff1d(near, kept).tolist():
        yield row, f'header.stamp is {stamp_ns[row] / NS_PER_S:.3f} s; the stamps fall back'


def _longest_ordered(stamps):
    """Return the places of a longest selection of stamps that never falls back."""
    # the least stamp that ends a selection of each length, its place, and the place before each
    ends, places, before = [], [], []
    for place, stamp in enumerate(stamps):
        length = bisect_right(ends, stamp)
        before.append(places[length - 1] if length else None)
        ends[length : length + 1], places[length : length + 1] = [stamp], [place]
    chosen = [places[-1]]
    while before[chosen[-1]] is not None:
        chosen.append(before[chosen[-1]])
    return chosen[::-1]
