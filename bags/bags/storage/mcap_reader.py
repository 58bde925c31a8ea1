"""Read the MCAP files of a bag into arrays, however damaged they are.

A bag is one file, or several numbered ones when it was split.
"""

import re
import struct
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema

from bags.errors import BagError
from bags.storage.mcap_scan import Damage, is_mcap, records_in_chunk, scan_records
from bags.storage.rosbag2_metadata import BagTopic
from msgs_yaml import missing_file

SUFFIX = '.mcap'
NUMBERED = re.compile(r'(?P<name>.*)_(?P<number>\d+)\.mcap')
# of a message record; times in ns
MESSAGE_HEADER = np.dtype(
    [('channel', '<u2'), ('sequence', '<u4'), ('log_ns', '<u8'), ('publish_ns', '<u8')]
)
LATEST_NS = np.iinfo(np.int64).max  # in the year 2262; later times are clipped
RECORDS = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel, Opcode.METADATA: Metadata}


def mcap_files(path: Path | str) -> list[Path]:
    """Return the files of a bag in the order of their numbers; `path` itself where it is a file.

    Raises BagError when there are none, or those of several bags.
    """
    path = Path(path)
    if not path.is_dir():
        if not path.exists():
            there = missing_file.describe_neighbours(path, 'bag', looks_like_bag)
            raise BagError(f'{path}: there is no such bag; {there}')
        return [path]
    files = sorted(path.glob(f'*{SUFFIX}'))
    if len(files) == 1:
        return files
    parts = [NUMBERED.fullmatch(file.name) for file in files]
    if not all(parts) or len({part['name'] for part in parts}) != 1:
        below = sorted(f.name for f in path.iterdir() if f.is_dir() and looks_like_bag(f))
        if below and not files:
            names = missing_file.list_names(below)
            raise BagError(f'{path}: is no bag, but holds some; give one of them: {names}')
        names = ', '.join(file.name for file in files) or 'none'
        raise BagError(
            f'{path}: not a bag: it must hold one file *.mcap, or the numbered ones of one bag; '
            f'it holds {names}'
        )
    return sorted(files, key=_number)


def looks_like_bag(path: Path) -> bool:
    """Return whether a path is a folder with an MCAP file, or such a file, by their names."""
    return any(path.glob(f'*{SUFFIX}')) if path.is_dir() else path.suffix == SUFFIX


def missing_before(file: Path, before: Path) -> str | None:
    """Return the name of the first file that is missing between two of a split bag, or None."""
    expected = _number(before) + 1
    if _number(file) == expected:
        return None
    return f'{NUMBERED.fullmatch(file.name)["name"]}_{expected}.mcap'


def _number(file):
    return int(NUMBERED.fullmatch(file.name)['number'])


class Contents(NamedTuple):
    """The contents of one file; n messages in file order, of known channels only."""

    topics: dict[int, BagTopic]  # by channel
    channel: np.ndarray  # (n,) int64
    sequence: np.ndarray  # (n,) int64
    log_ns: np.ndarray  # (n,) int64
    publish_ns: np.ndarray  # (n,) int64
    payloads: list[bytes]
    records: dict[str, dict[str, str]]  # metadata records by name
    damage: tuple[Damage, ...]  # in file order; empty for a file that was closed
    nameless: int  # messages left out because no record defines their channel
    indexed: bool  # it has a summary


_NONE = np.empty(0, dtype=np.int64)
EMPTY_FILE = Contents({}, *[_NONE] * 4, [], {}, (Damage(0, 'the file is empty'),), 0, False)


def read_mcap(file: Path, whole: bool = True) -> Contents:
    """Read an MCAP file; with `whole` also what follows the first damage.

    Raises BagError when it is no MCAP file, is empty or cannot be read.
    """
    try:
        data = file.read_bytes()
    except OSError as error:
        raise BagError(f'{file}: {error.strerror}') from error
    if not data:
        raise BagError(f'{file}: the file is empty')
    if not whole and not is_mcap(data):
        raise BagError(f'{file}: not a bag: it does not begin as an MCAP file')
    gathering, damage = _Gathering(), []
    for item in scan_records(data):
        if isinstance(item, Damage):
            damage.append(item)
        elif item.opcode == Opcode.CHUNK:
            gathering.has_chunks = True
            for opcode, begin, end in records_in_chunk(item.body):
                gathering.record(opcode, item.body[begin:end], item.checked)
        # in a file with chunks, a message outside of them is another record with a damaged opcode
        elif item.opcode != Opcode.MESSAGE or not gathering.has_chunks:
            gathering.record(item.opcode, item.body, trusted=False)
        if damage and not whole:
            break
    return gathering.contents(tuple(damage))


class _Gathering:
    """Collects definitions, messages and metadata in file order."""

    def __init__(self):
        self.has_chunks = self.indexed = False
        self.schemas, self.channels, self.trusted = {}, {}, set()
        self.heads, self.payloads, self.records = [], [], {}

    def record(self, opcode, body, trusted):
        self.indexed |= opcode == Opcode.STATISTICS
        if opcode == Opcode.MESSAGE and len(body) >= MESSAGE_HEADER.itemsize:
            self.heads.append(body[: MESSAGE_HEADER.itemsize])
            self.payloads.append(body[MESSAGE_HEADER.itemsize :])
            return
        if opcode not in RECORDS:
            return
        stream = ReadDataStream(BytesIO(body))
        try:
            record = RECORDS[opcode].read(stream)
        except (struct.error, UnicodeDecodeError, McapError):
            return
        if stream.count != len(body):
            return
        if isinstance(record, Metadata):
            self.records.setdefault(record.name, record.metadata)
            return
        # a definition with a valid checksum has precedence
        kept = self.channels if isinstance(record, Channel) else self.schemas
        key = opcode, record.id
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
        heads = np.frombuffer(b''.join(self.heads), MESSAGE_HEADER)
        known = np.isin(heads['channel'], list(topics))
        payloads = self.payloads
        if not known.all():
            heads, payloads = heads[known], [d for d, k in zip(payloads, known) if k]
        return Contents(
            topics,
            **{
                name: np.minimum(heads[name], np.uint64(LATEST_NS)).astype(np.int64)
                for name in MESSAGE_HEADER.names
            },
            payloads=payloads,
            records=self.records,
            damage=damage,
            nameless=len(known) - len(heads),
            indexed=self.indexed,
        )
