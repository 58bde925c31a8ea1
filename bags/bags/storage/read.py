"""Read a bag into columns and values. No ROS is needed, only the definitions inside the bag.

`read.columns('runs/double_lane_change/mpcc')['/vehicle/odometry'].vx_mps` is the speed of every
millisecond; whoever asks for more loads the bag once with `read.load`, and leaves out messages
that break the contract with `sift.sift`.
"""

import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from bags.errors import BagError, DamagedBagWarning
from bags.storage.columns import SOURCES, Columns, Values
from bags.storage.decoding import (
    DECODE_ERRORS,
    DECODERS,
    build_columns,
    decode_message,
    header_stamps_ns,
)
from bags.storage.mcap_reader import mcap_files, missing_before, read_mcap
from bags.storage.rosbag2_metadata import BagTopic
from msgs_yaml.conversions import NS_PER_S

STATE = '/vehicle/odometry'


class Recording(NamedTuple):
    """Everything recorded of one topic, n messages in the order of the file."""

    topic: BagTopic
    log_ns: np.ndarray  # (n,) int64, see the recorder for what it means in each mode
    publish_ns: np.ndarray  # (n,) int64, wall clock of the publisher
    sequence: np.ndarray  # (n,) int64, the publisher's count, 0 where unknown
    payloads: list[bytes]  # CDR with its encapsulation header


class InvalidMessages(NamedTuple):
    """The messages of one topic that break the contract."""

    count: int
    first: str  # which message was the first, and what is wrong with it


# no message broke the contract; nothing was decoded
NOTHING: Mapping = MappingProxyType({})


class Bag(NamedTuple):
    """A bag in memory."""

    path: Path  # of the MCAP file, of the folder when it was split
    files: tuple[Path, ...]  # in the order in which they were written
    recordings: dict[str, Recording]  # by topic, also those without messages
    records: dict[str, dict[str, str]]  # what else was noted, by the name of the MCAP record
    damage: str | None  # where it is damaged; what lies behind was not read
    # of a bag that was sifted (`sift.sift`): what was left out, by topic, and values decoded then
    invalid: Mapping[str, InvalidMessages] = NOTHING
    decoded: Mapping[str, list[Any]] = NOTHING
    sifted: bool = False

    @property
    def run_info(self) -> dict[str, str]:
        """Parameters, versions, scenario: what the starter noted."""
        return self.records.get('run', {})


def load(path: Path | str) -> Bag:
    """Read a bag: its folder, all files of it when it was split, or one MCAP file.

    A damaged bag is read up to the damage, with a DamagedBagWarning that says where it is. Raises
    BagError when there is no such file, it is not a bag, or it holds no message.
    """
    files = mcap_files(path)
    place = files[0] if len(files) == 1 else Path(path)
    found, damage = [], None
    for file, before in zip(files, [None, *files]):
        missing = before and missing_before(file, before)
        if missing:
            damage = f'{place}: {missing} is missing; read up to there'
            break
        found.append(read_mcap(file, whole=False))
        if found[-1].damage:
            damage = _where(file, found[-1].damage[0], path)
            break
    if not any(one.payloads for one in found):
        raise BagError(f'{place}: the bag holds no message')
    if damage:
        warnings.warn(damage, DamagedBagWarning, stacklevel=2)
    records = {}
    for one in found:
        records = one.records | records
    return Bag(place, tuple(files), _by_topic(place, found), records, damage)


def _where(file, damage, path):
    text = f'{file}: damaged at byte {damage.offset} ({damage.what}); read up to there, try'
    return f'{text} `bags repair {path}`'


def columns(bag: Bag | Path | str, topics: Iterable[str] | None = None) -> dict[str, Columns]:
    """Return the table of each topic, by default of every topic that has messages.

    A message that repeats the one before it byte for byte is left out: latched facts are repeated,
    and so is a state that waits for its first answer; how often depends on the wall clock, and
    columns must not. Numeric columns hold what was recorded: ranges are not checked, so sift a bag
    first whose publishers are not known. Raises BagError for a topic without messages (it names
    those that have some) and for a message that does not fit its definition, of topics without
    numeric columns also for one that breaks the contract.
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

    Raises BagError for a topic without messages and for a message that breaks the contract.
    """
    bag = _loaded(bag)
    recorded = recording(bag, topic)
    return _decoded(bag, recorded.topic, recorded.payloads)


def run_info(bag: Bag | Path | str) -> dict[str, str]:
    """Return what the starter noted about the run; empty when it noted nothing."""
    return _loaded(bag).run_info


def recording(bag: Bag, topic: str) -> Recording:
    """Return what was recorded of a topic; BagError when there is nothing."""
    if not _has(bag, topic) and topic in bag.invalid:
        count, first = bag.invalid[topic]
        raise BagError(f'{bag.path}: no valid message of {topic} among {count}; {first}')
    if not _has(bag, topic):
        present = ', '.join(name for name in bag.recordings if _has(bag, name))
        raise BagError(f'{bag.path}: no message of {topic}; it has {present}')
    return bag.recordings[topic]


def _has(bag, topic):
    return topic in bag.recordings and bool(bag.recordings[topic].payloads)


def _loaded(bag):
    return bag if isinstance(bag, Bag) else load(bag)


def _by_topic(place, found):
    """Put together what the files hold of each topic."""
    parts = {}
    for one in found:
        channels = {}
        for channel, topic in one.topics.items():
            channels.setdefault(topic.name, []).append(channel)
        for name, numbers in channels.items():
            topics = [one.topics[number] for number in numbers]
            rows = np.flatnonzero(np.isin(one.channel, numbers))
            parts.setdefault(name, []).append((topics, one, rows))
    return {name: _recording(place, each) for name, each in parts.items()}


def _recording(place, parts):
    described = [topic for topics, _, _ in parts for topic in topics]
    if len({topic.type for topic in described}) > 1:
        raise BagError(f'{place}: {described[0].name} has messages of two types')
    times = (
        np.concatenate([getattr(one, name)[rows] for _, one, rows in parts])
        for name in ('log_ns', 'publish_ns', 'sequence')
    )
    payloads = [data for _, one, rows in parts for data in map(one.payloads.__getitem__, rows)]
    return Recording(described[-1], *times, payloads)


def _zero_ns(bag):
    """Stamp of the first state; of the first message where no state was recorded."""
    if _has(bag, STATE):
        try:
            return int(header_stamps_ns(STATE, bag.recordings[STATE].payloads[:1])[0])
        except BagError as error:
            raise BagError(f'{bag.path}: {error}') from error
    return min(int(r.log_ns[0]) for r in bag.recordings.values() if r.payloads)


def _table(bag, name, zero_ns):
    recorded = recording(bag, name)
    payloads = _changes(recorded.payloads)
    if name in SOURCES:
        try:
            return build_columns(SOURCES[name], recorded.topic, payloads, zero_ns)
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
    found = dict(zip(bag.recordings[topic.name].payloads, bag.decoded.get(topic.name, ())))
    for i, payload in enumerate(payloads):
        if payload in found:
            continue
        try:
            found[payload] = decode_message(topic, payload)
        except DECODE_ERRORS as error:
            raise BagError(f'{bag.path}: message {i} of {topic.name}: {error}') from error
    return [found[payload] for payload in payloads]
