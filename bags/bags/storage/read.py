"""Read a bag into columns and values. No ROS is needed, only the definitions inside the bag.

`read.columns('runs/double_lane_change/mpcc')['/vehicle/odometry'].vx_mps` is the speed of every
millisecond. For several topics, load the bag once with `read.load`; messages that break the
contract are left out by `invalid_messages.drop_invalid`.
"""

import warnings
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from bags.errors import BagError, DamagedBagWarning
from bags.storage.columns import (
    DECODE_ERRORS,
    DECODERS,
    TOPICS,
    Columns,
    build_columns,
    decode_each,
    header_stamps_ns,
)
from bags.storage.mcap_reader import mcap_files, missing_before, read_mcap
from bags.storage.rosbag2_metadata import BagTopic
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.strict_yaml import closest

STATE = '/vehicle/odometry'
HEALTH = '/diagnostics'
LOCKSTEP = 'lockstep'  # the mode of a run in simulated time


class Recording(NamedTuple):
    """Everything recorded of one topic, n messages in the order of the file."""

    topic: BagTopic
    log_ns: np.ndarray  # (n,) int64, see the recorder for what it means in each mode
    publish_ns: np.ndarray  # (n,) int64, wall clock of the publisher
    sequence: np.ndarray  # (n,) int64, the publisher's count, 0 where unknown
    payloads: list[bytes]  # CDR with its encapsulation header

    def rows(self, kept: np.ndarray) -> 'Recording':
        """Return the messages of these rows (m,)."""
        columns = (column[kept] for column in self[1:4])
        return Recording(self.topic, *columns, [self.payloads[row] for row in kept])

    def __repr__(self):
        return f'Recording({self.topic.name}, {len(self.payloads)} messages)'


class InvalidMessages(NamedTuple):
    """The messages of one topic that break the contract."""

    count: int
    first: str  # which message was the first, and what is wrong with it


NOTHING: Mapping = MappingProxyType({})


class Bag(NamedTuple):
    """A bag in memory."""

    path: Path  # of the MCAP file, of the folder when it was split
    files: tuple[Path, ...]  # in the order in which they were written
    recordings: dict[str, Recording]  # by topic, also those without messages
    records: dict[str, dict[str, str]]  # MCAP metadata records by name
    damage: str | None  # position of the first damage; what follows it was not read
    # after `invalid_messages.drop_invalid`: what was left out, by topic, and values decoded then
    invalid: Mapping[str, InvalidMessages] = NOTHING
    decoded: Mapping[str, list[Any]] = NOTHING
    filtered: bool = False

    @property
    def run_info(self) -> dict[str, str]:
        """Parameters, versions, scenario: the metadata record `run`."""
        return self.records.get('run', {})

    def __repr__(self):
        count = sum(len(recorded.payloads) for recorded in self.recordings.values())
        return f'Bag({self.path}, {count} messages of {len(self.recordings)} topics)'


def load(path: Path | str, warn: bool = True) -> Bag:
    """Read a bag: its folder, all files of it when it was split, or one MCAP file.

    A damaged bag is read up to the damage, which `Bag.damage` describes, and a DamagedBagWarning
    unless `warn` is false. Raises BagError when there is no such file, it is not a bag, or it holds
    no message.
    """
    files = mcap_files(path)
    bag_path = files[0] if len(files) == 1 else Path(path)
    contents, damage = [], None
    for file, before in zip(files, [None, *files]):
        missing = before and missing_before(file, before)
        if missing:
            damage = f'{bag_path}: {missing} is missing; read up to there'
            break
        contents.append(read_mcap(file, whole=False))
        if contents[-1].damage:
            first = contents[-1].damage[0]
            damage = (
                f'{file}: damaged at byte {first.offset} ({first.what}); read up to there, try '
                f'`bags repair {path}`'
            )
            break
    if not any(file.payloads for file in contents):
        raise BagError(f'{bag_path}: the bag holds no message')
    if damage and warn:
        warnings.warn(damage, DamagedBagWarning, stacklevel=2)
    # each topic as it was described last
    records, topics, recordings = {}, {}, {}
    for file in contents:
        records = file.records | records
        for topic in file.topics.values():
            if topics.get(topic.name, topic).type != topic.type:
                raise BagError(f'{bag_path}: {topic.name} has messages of two types')
            topics[topic.name] = topic
    for name, topic in topics.items():
        own = []
        for file in contents:
            channels = [number for number, other in file.topics.items() if other.name == name]
            rows = np.flatnonzero(np.isin(file.channel, channels))
            columns = (column[rows] for column in (file.log_ns, file.publish_ns, file.sequence))
            own.append((*columns, [file.payloads[row] for row in rows]))
        *times, payloads = zip(*own)
        payloads = [payload for part in payloads for payload in part]
        recordings[name] = Recording(topic, *map(np.concatenate, times), payloads)
    return Bag(bag_path, tuple(files), recordings, records, damage)


def columns(bag: Bag | Path | str, topics: Iterable[str] | None = None) -> dict[str, Columns]:
    """Return the table of each topic, by default of every topic that has messages.

    A message that repeats the one before it byte for byte is left out: other recorders keep what is
    sent again while time waits; how often depends on the wall clock, and columns must not. Ranges
    of numeric columns are not checked: apply `drop_invalid` first to a bag of unknown publishers.
    Raises BagError for a topic without messages (it names those that have some) and for a message
    that does not fit its definition; of topics without numeric columns also for one that breaks the
    contract.
    """
    bag = bag if isinstance(bag, Bag) else load(bag)
    if topics is None:
        topics = [name for name in bag.recordings if name in DECODERS and has_messages(bag, name)]
    # the stamp of the first state; of the first message without any state
    zero_ns = min((int(r.log_ns[0]) for r in bag.recordings.values() if r.payloads), default=0)
    if has_messages(bag, STATE):
        try:
            zero_ns = int(header_stamps_ns(STATE, bag.recordings[STATE].payloads[:1])[0])
        except BagError as error:
            raise BagError(f'{bag.path}: {error}') from error
    return {name: _table(bag, name, zero_ns) for name in topics}


def values(bag: Bag | Path | str, topic: str) -> list[Any]:
    """Return every message of a topic as a value of `msgs_yaml.types` (times alone: ns).

    Of /diagnostics every status is one, of which a message may have several.

    Raises BagError for a topic without messages and for a message that breaks the contract.
    """
    bag = bag if isinstance(bag, Bag) else load(bag)
    recorded = recording(bag, topic)
    return _decoded(bag, recorded.topic, recorded.payloads)


def run_info(bag: Bag | Path | str) -> dict[str, str]:
    """Return the metadata record `run`: parameters, versions, scenario; empty without it."""
    return (bag if isinstance(bag, Bag) else load(bag)).run_info


def recording(bag: Bag, topic: str) -> Recording:
    """Return the messages of a topic; BagError when there are none."""
    if not has_messages(bag, topic):
        present = [name for name in bag.recordings if has_messages(bag, name)]
        text = describe_missing(topic, present, bag.recordings, bag.invalid.get(topic))
        raise BagError(f'{bag.path}: {text}')
    return bag.recordings[topic]


def describe_missing(
    topic: str, present: Collection[str], known: Collection[str], invalid: InvalidMessages | None
) -> str:
    """Return why there is no message of a topic; `present` are the topics that have some."""
    if invalid:
        return f'no valid message of {topic} among {invalid.count}; {invalid.first}'
    # a known topic without messages is no misspelling
    hint = '' if topic in known else closest(topic, present)
    return f'no message of {topic}; it has {", ".join(present)}{hint}'


def has_messages(bag: Bag, *topics: str) -> bool:
    """Return whether there is a message of each of the topics."""
    return all(name in bag.recordings and bool(bag.recordings[name].payloads) for name in topics)


def _table(bag, name, zero_ns):
    recorded = recording(bag, name)
    # without those that repeat the one before
    pairs = zip(recorded.payloads, [None, *recorded.payloads])
    payloads = [payload for payload, before in pairs if payload != before]
    if name in TOPICS:
        try:
            return build_columns(recorded.topic, payloads, zero_ns)
        except BagError as error:
            raise BagError(f'{bag.path}: {name}: {error}') from error
    decoded = _decoded(bag, recorded.topic, payloads)
    stamp_ns = np.array([getattr(value, 'stamp_ns', value) for value in decoded], dtype=np.int64)
    return Columns(stamp_ns, (stamp_ns - zero_ns) / NS_PER_S, values=tuple(decoded))


def _decoded(bag, topic, payloads):
    if topic.name not in DECODERS:
        raise BagError(f'{bag.path}: {topic.name} is no topic of the contract')
    known = dict(zip(bag.recordings[topic.name].payloads, bag.decoded.get(topic.name, ())))
    known |= decode_each(topic, [payload for payload in payloads if payload not in known])
    decoded = [known[payload] for payload in payloads]
    for i, error in enumerate(decoded):
        if isinstance(error, DECODE_ERRORS):
            raise BagError(f'{bag.path}: message {i} of {topic.name}: {error}') from error
    if topic.name == HEALTH:
        return [status for statuses in decoded for status in statuses]
    return decoded
