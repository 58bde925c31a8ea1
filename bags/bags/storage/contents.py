"""Everything an MCAP file of ROS messages holds, as plain values, however damaged it is."""

import struct
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema

from bags.errors import BagError
from bags.storage.rosbag2_layout import BagTopic
from bags.storage.scan import Damage, inner, is_mcap, scan

MESSAGE = struct.Struct('<HIQQ')  # channel, sequence, log time, publish time
RECORDS = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel, Opcode.METADATA: Metadata}


class Message(NamedTuple):
    """One recorded message; times in ns, `data` is CDR with its encapsulation header."""

    channel: int
    sequence: int  # the publisher's own count, 0 where unknown
    log_ns: int
    publish_ns: int
    data: bytes


class Contents(NamedTuple):
    """What was found."""

    topics: dict[int, BagTopic]  # by channel
    messages: list[Message]  # in file order, of known channels only
    records: dict[str, dict[str, str]]  # metadata records by name
    damage: tuple[Damage, ...]  # in file order; empty for a file that was closed
    nameless: int  # messages left out because their channel is defined nowhere
    indexed: bool  # it has a summary


def mcap_path(path: Path | str) -> Path:
    """The MCAP file of a bag: `path` itself, or the one file *.mcap in a folder.

    Raises BagError when there is none, or more than one.
    """
    path = Path(path)
    if path.is_dir():
        found = sorted(path.glob('*.mcap'))
        if len(found) != 1:
            names = ', '.join(file.name for file in found) or 'none'
            raise BagError(f'{path}: not a bag: it must hold one file *.mcap, it holds {names}')
        return found[0]
    if not path.exists():
        raise BagError(f'{path}: there is no such bag')
    return path


def load(path: Path | str, whole: bool = True) -> Contents:
    """Read a bag (folder or file); with `whole` also what lies behind damage.

    Raises BagError when it is no MCAP file, is empty or cannot be read.
    """
    file = mcap_path(path)
    try:
        data = file.read_bytes()
    except OSError as error:
        raise BagError(f'{file}: {error.strerror}') from error
    if not data:
        raise BagError(f'{file}: the file is empty')
    if not whole and not is_mcap(data):
        raise BagError(f'{file}: not a bag: it does not begin as an MCAP file')
    return _collect(scan(data), whole)


def _collect(found, whole):
    gathering = _Gathering()
    damage = []
    for item in found:
        if isinstance(item, Damage):
            damage.append(item)
        elif item.opcode == Opcode.CHUNK:
            gathering.chunk(item.body, item.checked)
        # a message outside chunks, where there are chunks, is another record with a wrong head
        elif item.opcode != Opcode.MESSAGE or not gathering.has_chunks:
            gathering.record(item.opcode, item.body, trusted=False)
        if damage and not whole:
            break
    return gathering.contents(tuple(damage))


class _Gathering:
    """Definitions, messages and metadata as they come."""

    def __init__(self):
        self.has_chunks = self.indexed = False
        self.schemas, self.channels, self.trusted = {}, {}, set()
        self.messages, self.records = [], {}

    def chunk(self, contents, trusted):
        self.has_chunks = True
        unpack, size, add = MESSAGE.unpack_from, MESSAGE.size, self.messages.append
        for opcode, begin, end in inner(contents):
            if opcode != Opcode.MESSAGE:
                self.record(opcode, contents[begin:end], trusted)
            elif end - begin >= size:
                add(Message(*unpack(contents, begin), contents[begin + size : end]))

    def record(self, opcode, body, trusted):
        self.indexed |= opcode == Opcode.STATISTICS
        if opcode == Opcode.MESSAGE and len(body) >= MESSAGE.size:
            self.messages.append(Message(*MESSAGE.unpack_from(body), body[MESSAGE.size :]))
        record = _parse(opcode, body)
        if isinstance(record, Metadata):
            self.records.setdefault(record.name, record.metadata)
        elif record is not None:
            self.define(record, trusted)

    def define(self, record, trusted):
        """Keep a definition; one that a checksum covers goes before one without."""
        kept = self.channels if isinstance(record, Channel) else self.schemas
        key = type(record), record.id
        if record.id not in kept or (trusted and key not in self.trusted):
            kept[record.id] = record
            if trusted:
                self.trusted.add(key)

    def contents(self, damage):
        topics = {}
        for id_, channel in sorted(self.channels.items()):
            schema = self.schemas.get(channel.schema_id)
            if schema is not None and channel.message_encoding == 'cdr':
                topics[id_] = BagTopic(
                    name=channel.topic,
                    type=schema.name,
                    schema=schema.data.decode('utf-8', 'replace'),
                    type_hash=channel.metadata.get('topic_type_hash', ''),
                    qos=channel.metadata.get('offered_qos_profiles', ''),
                )
        messages = [message for message in self.messages if message.channel in topics]
        nameless = len(self.messages) - len(messages)
        return Contents(topics, messages, self.records, damage, nameless, self.indexed)


def _parse(opcode, body):
    """Schema, channel or metadata; None for anything else and for what is not whole."""
    if opcode not in RECORDS:
        return None
    stream = ReadDataStream(BytesIO(body))
    try:
        record = RECORDS[opcode].read(stream)
    except (struct.error, UnicodeDecodeError, McapError):
        return None
    return record if stream.count == len(body) else None
