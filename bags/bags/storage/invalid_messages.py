"""Drop the messages of a bag that break the contract, and count them by topic.

Nodes reject such messages and continue, and so do the tools that read a recording: the publisher
may be a foreign program, or the car may have left the ranges of the contract. Samples of the car
whose stamp does not fit the time of the recording are dropped, too.
"""

from bisect import bisect_right
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from bags.errors import BagError
from bags.storage.cdr import Layout
from bags.storage.columns import (
    DECODE_ERRORS,
    DECODERS,
    TOPICS,
    column,
    decode_each,
    group_by_layout,
    header_stamps_ns,
    stamp_columns,
)
from bags.storage.read import LOCKSTEP, STATE, Bag, InvalidMessages
from bags.storage.rosbag2_metadata import BagTopic
from msgs_yaml import conformance, contract, flat_fields
from msgs_yaml.contract import JOINT_ARRAYS
from msgs_yaml.conversions import NS_PER_S

KEY = 'invalid_messages'  # in JSON
OBSTACLES = '/scenario/obstacles'
OBJECTS = f'objects of {OBSTACLES}'
VEHICLE_TOPICS = ('/vehicle/odometry', '/vehicle/actuators', '/vehicle/imu', '/vehicle/wheels')
# How much the delay from stamp to log time may differ from the median: a plant that was stopped
# for minutes sends what it missed, and no other clock is as near by chance.
NEAR_NS = 600 * NS_PER_S


def drop_invalid(bag: Bag) -> Bag:
    """Return the bag without the messages that break the contract; `Bag.invalid` counts them.

    Samples of the car with foreign stamps are dropped likewise (`find_foreign_stamps`). In
    lockstep a second state of one stamp stays: it is that of a second plant, for which a reader
    may refuse the bag. Topics that the contract does not define stay as they are, and so does a
    bag that was filtered before.
    """
    if bag.filtered:
        return bag
    recordings, decoded, invalid = dict(bag.recordings), {}, {}
    for name, recorded in bag.recordings.items():
        if name not in DECODERS or not recorded.payloads:
            continue
        payloads, reasons = recorded.payloads, {}
        valid = obeys_contract(recorded.topic, payloads)
        # the others are decoded, which decides and gives the reason
        doubtful = np.flatnonzero(~valid).tolist()
        known = decode_each(recorded.topic, [payloads[i] for i in doubtful])
        for i in doubtful:
            if isinstance(error := known[payloads[i]], DECODE_ERRORS):
                reasons[i] = str(error).removeprefix(f'{name}: ') or type(error).__name__
        if name in VEHICLE_TOPICS:
            keep_twins = name == STATE and bag.run_info.get('mode') == LOCKSTEP
            # of those that obey the contract
            rows = np.setdiff1d(np.arange(len(payloads)), list(reasons))
            stamp_ns = header_stamps_ns(name, [payloads[row] for row in rows])
            foreign = find_foreign_stamps(stamp_ns, recorded.log_ns[rows], keep_twins)
            reasons |= {int(rows[k]): reason for k, reason in foreign}
        kept = np.setdiff1d(np.arange(len(payloads)), list(reasons))
        if not valid.any():
            decoded[name] = [known[payloads[i]] for i in kept]
        if reasons:
            recordings[name] = recorded.rows(kept)
            first = min(reasons)
            invalid[name] = InvalidMessages(len(reasons), f'message {first}: {reasons[first]}')
    return bag._replace(recordings=recordings, decoded=decoded, invalid=invalid, filtered=True)


def count_invalid(bag: Bag) -> dict[str, dict[str, dict[str, Any]]]:
    """Return {'invalid_messages': {topic: {count, first}}} of a filtered bag, {} without any.

    The objects that were refused of messages of obstacles are a topic of their own, OBJECTS.
    """
    counts = {topic: invalid._asdict() for topic, invalid in bag.invalid.items()}
    refused = [r for obstacles in bag.decoded.get(OBSTACLES, ()) for r in obstacles.refused]
    if refused:
        counts[OBJECTS] = {'count': len(refused), 'first': refused[0].reason}
    return {KEY: counts} if counts else {}


def describe_invalid(summary: Mapping[str, Any]) -> Iterator[str]:
    """Yield a line per topic from a dictionary that contains the result of `count_invalid`."""
    for topic, invalid in summary.get(KEY, {}).items():
        kind = topic if topic == OBJECTS else f'messages of {topic}'
        yield f'{invalid["count"]} invalid {kind} were left out; {invalid["first"]}'


def obeys_contract(topic: BagTopic, payloads: list[bytes]) -> np.ndarray:
    """Return for each message (n,) whether it certainly obeys the contract.

    Checks all messages as arrays, 100 times faster than `decode_message` and never laxer: the
    messages that fail here are decoded, which decides and gives the reason. All fail of a topic
    without a table, and when one of them does not fit its definition.
    """
    obeys = np.zeros(len(payloads), dtype=bool)
    if topic.name not in TOPICS:
        return obeys
    known, fields = contract.load().topics[topic.name], flat_fields.load(topic.name)
    example = fields.fill(fields.to_value(0, [0.0] * len(fields.paths)))
    try:
        wanted = Layout(example, topic.schema, topic.type)
        for rows, bytes_, layout in group_by_layout(payloads, topic.schema, topic.type):
            # frames, joint names and array lengths are those of the contract
            if (layout.strings, layout.numbers) != (wanted.strings, wanted.numbers):
                continue
            sec, nanosec = stamp_columns(bytes_, layout)
            valid = (sec > 0) | (sec == 0) & (nanosec > 0)
            numbers = {path: column(bytes_, layout, path) for path in known.fields}
            valid &= conformance.obeys(known.name, numbers)
            # a JointState's unused entries, too, must be finite
            for path in layout.numbers if known.joints else ():
                if path.startswith(JOINT_ARRAYS):
                    valid &= np.isfinite(column(bytes_, layout, path))
            obeys[rows] = valid
    except BagError:
        return np.zeros(len(payloads), dtype=bool)
    return obeys


def find_foreign_stamps(
    stamp_ns: np.ndarray, log_ns: np.ndarray, keep_twins: bool = False
) -> Iterator[tuple[int, str]]:
    """Yield (row, reason) of the samples of a topic whose stamp is of another clock.

    Any stamp after 1970 obeys the contract, also that of a player or of a run in simulated time
    that publishes on the topics of a run in real time. From stamp to log time all samples of a
    topic take about as long. Samples that differ by more than NEAR_NS are foreign; of the others
    as few as possible, so that the remaining stamps never decrease. With `keep_twins` samples
    whose stamp equals a remaining one stay.
    """
    if not stamp_ns.size:
        return
    delay_ns = log_ns - stamp_ns
    deviation_ns = delay_ns - np.median(delay_ns)
    near = np.flatnonzero(np.abs(deviation_ns) <= NEAR_NS)
    for row in np.setdiff1d(np.arange(len(stamp_ns)), near).tolist():
        yield (
            row,
            f'header.stamp is {stamp_ns[row] / NS_PER_S:.3f} s, '
            f'{abs(deviation_ns[row]) / NS_PER_S:.0f} s from the stamps that were recorded about '
            f'then; allowed up to {NEAR_NS / NS_PER_S:.0f} s',
        )
    if np.all(np.diff(stamp_ns[near]) >= 0):
        return
    kept = near[_longest_ordered(stamp_ns[near].tolist())]
    if keep_twins:
        kept = near[np.isin(stamp_ns[near], stamp_ns[kept])]
    for row in np.setdiff1d(near, kept).tolist():
        yield row, f'header.stamp is {stamp_ns[row] / NS_PER_S:.3f} s; the stamps fall back'


def _longest_ordered(stamps):
    """Return the indices of a longest non-decreasing subsequence of the stamps."""
    # of each length the least stamp that ends a subsequence, its index, and the index before each
    ends, indices, before = [], [], []
    for index, stamp in enumerate(stamps):
        length = bisect_right(ends, stamp)
        before.append(indices[length - 1] if length else None)
        ends[length : length + 1], indices[length : length + 1] = [stamp], [index]
    result = [indices[-1]]
    while before[result[-1]] is not None:
        result.append(before[result[-1]])
    return result[::-1]
