"""Read a bag into columns and values. No ROS is needed, only the definitions inside the bag.

`read.columns('runs/double_lane_change/mpcc')['/vehicle/odometry'].vx_mps` is the speed of every
millisecond; whoever asks for more loads the bag once with `read.load`.
"""

import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bags.errors import BagError, DamagedBagWarning
from bags.storage import cdr, contents, tables
from bags.storage.columns import SOURCES, Columns, Values
from bags.storage.rosbag2_layout import BagTopic
from msgs_yaml import decode
from msgs_yaml.stamp import NS_PER_S

DECODERS = {
    '/scenario/reference': decode.reference,
    '/scenario/road_edges': decode.road_edges,
    '/scenario/obstacles': decode.obstacles,
    '/vehicle/odometry': decode.odometry,
    '/vehicle/actuators': decode.actuators,
    '/vehicle/imu': decode.imu,
    '/vehicle/wheels': decode.wheels,
    '/controller/command': decode.command,
    '/controller/prediction': decode.prediction,
    '/controller/why': decode.why,
    '/diagnostics': decode.health,
    '/clock': decode.clock,
}
STATE = '/vehicle/odometry'


class Recording(NamedTuple):
    """Everything recorded of one topic, n messages in the order of the file."""

    topic: BagTopic
    log_ns: np.ndarray  # (n,) int64, see the recorder for what it means in each mode
    publish_ns: np.ndarray  # (n,) int64, wall clock of the publisher
    sequence: np.ndarray  # (n,) int64, the publisher's count, 0 where unknown
    payloads: list[bytes]  # CDR with its encapsulation header


class Bag(NamedTuple):
    """A bag in memory."""

    path: Path  # of the MCAP file
    recordings: dict[str, Recording]  # by topic, also those without messages
    run_info: dict[str, str]  # parameters, versions, scenario: what the starter noted
    damage: str | None  # where the file is damaged; what lies behind it was not read


def load(path: Path | str) -> Bag:
    """Read a bag: its folder, or its MCAP file.

    A damaged bag is read up to the damage, with a DamagedBagWarning that says where it is. Raises
    BagError when there is no such file, it is not a bag, or it holds no message.
    """
    file = contents.mcap_path(path)
    found = contents.load(file, whole=False)
    if not found.messages:
        raise BagError(f'{file}: the bag holds no message')
    damage = None
    if found.damage:
        at = found.damage[0]
        damage = f'{file}: damaged at byte {at.offset} ({at.what}); read up to there, try'
        damage = f'{damage} `bags repair {path}`'
        warnings.warn(damage, DamagedBagWarning, stacklevel=2)
    return Bag(file, _by_topic(file, found), found.records.get('run', {}), damage)


def columns(bag: Bag | Path | str, topics: Iterable[str] | None = None) -> dict[str, Columns]:
    """Return the table of each topic, by default of every topic that has messages.

    A message that repeats the one before it byte for byte is left out: latched facts are repeated,
    and so is a state that waits for its first answer; how often depends on the wall clock, and
    columns must not. Raises BagError for a topic without messages (it names those that have some)
    and for a message that breaks the contract.
    """
    bag = _loaded(bag)
    if topics is None:
        topics = [
            n for n, recorded in bag.recordings.items() if recorded.payloads and n in DECODERS
        ]
    zero_ns = _zero_ns(bag)
    return {name: _table(bag, name, zero_ns) for name in topics}


def values(bag: Bag | Path | str, topic: str) -> list[Any]:
    """Return every message of a topic as a value of `msgs_yaml.types` (/clock: ns).

    Raises BagError as `columns` does.
    """
    bag = _loaded(bag)
    recorded = recording(bag, topic)
    return _decoded(bag, recorded.topic, recorded.payloads)


def run_info(bag: Bag | Path | str) -> dict[str, str]:
    """Return what the starter noted about the run; empty when it noted nothing."""
    return _loaded(bag).run_info


def recording(bag: Bag, topic: str) -> Recording:
    """Return what was recorded of a topic; BagError when there is nothing."""
    if not _has(bag, topic):
        present = ', '.join(name for name in bag.recordings if _has(bag, name))
        raise BagError(f'{bag.path}: no message of {topic}; it has {present}')
    return bag.recordings[topic]


def _has(bag, topic):
    return topic in bag.recordings and bool(bag.recordings[topic].payloads)


def _loaded(bag):
    return bag if isinstance(bag, Bag) else load(bag)


def _by_topic(file, found):
    names = {channel: topic.name for channel, topic in found.topics.items()}
    topics = {topic.name: topic for topic in found.topics.values()}
    for topic in found.topics.values():
        if topics[topic.name].type != topic.type:
            raise BagError(f'{file}: {topic.name} has messages of two types')
    messages = {name: [] for name in topics}
    for message in found.messages:
        messages[names[message.channel]].append(message)
    return {name: _recording(topic, messages[name]) for name, topic in topics.items()}


def _recording(topic, messages):
    if not messages:
        nothing = np.empty(0, dtype=np.int64)
        return Recording(topic, nothing, nothing, nothing, [])
    _, sequence, log_ns, publish_ns, payloads = zip(*messages)
    times = (np.array(column, dtype=np.int64) for column in (log_ns, publish_ns, sequence))
    return Recording(topic, *times, list(payloads))


def _zero_ns(bag):
    """Stamp of the first state; of the first message where no state was recorded."""
    if _has(bag, STATE):
        return decode.stamp_ns_of(bag.recordings[STATE].payloads[0])
    return min(int(r.log_ns[0]) for r in bag.recordings.values() if r.payloads)


def _table(bag, name, zero_ns):
    recorded = recording(bag, name)
    payloads = _changes(recorded.payloads)
    if name in SOURCES:
        try:
            return tables.build(SOURCES[name], recorded.topic, payloads, zero_ns)
        except BagError as error:
            raise BagError(f'{bag.path}: {name}: {error}') from error
    found = _decoded(bag, recorded.topic, payloads)
    stamp_ns = np.array([getattr(v, 'stamp_ns', v) for v in found], dtype=np.int64)
    return Values(stamp_ns, (stamp_ns - zero_ns) / NS_PER_S, tuple(found))


def _changes(payloads):
    """The messages that differ from the one before."""
    return [p for p, before in zip(payloads, [None, *payloads]) if p != before]


def _decoded(bag, topic, payloads):
    if topic.name not in DECODERS:
        raise BagError(f'{bag.path}: {topic.name} is no topic of the contract')
    decoder, found = DECODERS[topic.name], {}
    for i, payload in enumerate(payloads):
        if payload in found:
            continue
        try:
            found[payload] = decoder(cdr.decode(payload, topic.schema, topic.type))
        except (BagError, decode.DecodeError) as error:
            raise BagError(f'{bag.path}: message {i} of {topic.name}: {error}') from error
    return [found[payload] for payload in payloads]
