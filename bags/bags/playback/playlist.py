"""What of a bag is sent when: the part, the topics, and a clock where none was recorded. No ROS."""

import struct
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from bags.errors import BagError
from bags.storage import read
from bags.storage.rosbag2_layout import BagTopic, offered, qos_text
from msgs_yaml.stamp import NS_PER_S

CLOCK = BagTopic(
    name='/clock',
    type='rosgraph_msgs/msg/Clock',
    schema='',  # sent, never written
    type_hash='',
    qos=qos_text('keep_last', 1, 'reliable', 'volatile'),
)
CLOCK_CDR = struct.Struct('<4siI')
LITTLE_ENDIAN = b'\x00\x01\x00\x00'


class Part(NamedTuple):
    """Which part of a bag; durations in s of the bag."""

    start_s: float = 0.0
    duration_s: float = 0.0  # 0: to the end
    topics: Collection[str] = ()  # none: all


WHOLE = Part()


class Playlist(NamedTuple):
    """n messages in the order in which they are sent."""

    topics: tuple[BagTopic, ...]
    due_ns: np.ndarray  # (n,) int64, from the start of the part, never decreasing
    topic: np.ndarray  # (n,) index into `topics`
    payloads: list[bytes]  # CDR with its encapsulation header
    first_ns: int  # log time at the start of the part
    duration_ns: int


def of(bag: read.Bag, part: Part = WHOLE, clock_hz: float = 0.0) -> Playlist:
    """Return the messages of a part; each topic keeps its order, topics meet in log time.

    Of a latched topic the last message before the part is sent at its start. A part without
    messages of /clock is given some, `clock_hz` per second of the bag, unless that is 0. Raises
    BagError for a topic that the bag has not, and for a part without messages.
    """
    chosen = _chosen(bag, part.topics)
    # within a topic the file has the order of arrival, times may repeat or step back a little
    times = [np.maximum.accumulate(recorded.log_ns) for recorded in chosen]
    first_ns = min(int(t[0]) for t in times) + round(part.start_s * NS_PER_S)
    last_ns = max(int(t[-1]) for t in times)
    if part.duration_s:
        last_ns = min(last_ns, first_ns + round(part.duration_s * NS_PER_S))
    rows = [_rows(r, t, first_ns, last_ns) for r, t in zip(chosen, times)]
    if not sum(map(len, rows)):
        raise BagError(f'{bag.path}: no message from {part.start_s:g} s on; nothing to play')
    due = [np.maximum(t[i] - first_ns, 0) for t, i in zip(times, rows)]
    payloads = [data for r, i in zip(chosen, rows) for data in map(r.payloads.__getitem__, i)]
    topics = [recorded.topic for recorded in chosen]
    if clock_hz and not any(t.name == CLOCK.name and len(i) for t, i in zip(topics, rows)):
        # before everything else: of equal times it is sent first
        ticks = np.arange(0, last_ns - first_ns + 1, round(NS_PER_S / clock_hz))
        topics, due = [CLOCK, *topics], [ticks, *due]
        payloads = [*_clock(first_ns + ticks), *payloads]
    number = np.repeat(np.arange(len(due)), [len(d) for d in due])
    due = np.concatenate(due)
    order = np.argsort(due, kind='stable')
    return Playlist(
        topics=tuple(topics),
        due_ns=due[order],
        topic=number[order],
        payloads=[payloads[i] for i in order],
        first_ns=first_ns,
        duration_ns=last_ns - first_ns,
    )


def _chosen(bag, names):
    present = {name: r for name, r in bag.recordings.items() if r.payloads}
    for name in names:
        if name not in present:
            raise BagError(f'{bag.path}: no message of {name}; it has {", ".join(present)}')
    return [present[name] for name in present if not names or name in names]


def _rows(recorded, times, first_ns, last_ns):
    """Rows of the part, with the latched message that was in force at its start."""
    begin, end = np.searchsorted(times, [first_ns, last_ns + 1]).tolist()
    is_latched = begin > 0 and 'transient_local' in (
        profile['durability'] for profile in offered(recorded.topic.qos)
    )
    return np.arange(begin - is_latched, max(begin, end))


def _clock(times_ns):
    return [CLOCK_CDR.pack(LITTLE_ENDIAN, *divmod(ns, NS_PER_S)) for ns in times_ns.tolist()]
