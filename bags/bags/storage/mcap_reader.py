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
    has_chunks = indexed = False
    # definitions by opcode and number, each with whether a checksum vouches for it
    defined, heads, payloads, records, damage = {}, [], [], {}, []
    for item in scan_records(data):
        if isinstance(item, Damage):
            damage.append(item)
            if not whole:
                break
            continue
        is_chunk = item.opcode == Opcode.CHUNK
        has_chunks |= is_chunk
        # in a file with chunks, a message outside of them is another record with a damaged opcode
        if item.opcode == Opcode.MESSAGE and has_chunks:
            continue
        own = [(item.opcode, 0, len(item.body))]
        for opcode, begin, end in records_in_chunk(item.body) if is_chunk else own:
            body = item.body[begin:end]
            indexed |= opcode == Opcode.STATISTICS
            if opcode == Opcode.MESSAGE and len(body) >= MESSAGE_HEADER.itemsize:
                heads.append(body[: MESSAGE_HEADER.itemsize])
                payloads.append(body[MESSAGE_HEADER.itemsize :])
            elif (record := _parse(opcode, body)) is not None:
                if isinstance(record, Metadata):
                    records.setdefault(record.name, record.metadata)
                # a definition with a valid checksum has precedence
                elif item.checked > defined.get((opcode, record.id), (None, -1))[1]:
                    defined[opcode, record.id] = record, item.checked
    topics = {}
    for (opcode, number), (channel, _) in sorted(defined.items(), key=lambda entry: entry[0]):
        schema, _ = defined.get((Opcode.SCHEMA, getattr(channel, 'schema_id', 0)), (None, False))
        if opcode == Opcode.CHANNEL and schema and channel.message_encoding == 'cdr':
            topics[number] = BagTopic(
                name=channel.topic,
                type=schema.name,
                schema=schema.data.decode('utf-8', 'replace'),
                type_hash=channel.metadata.get('topic_type_hash', ''),
                qos=channel.metadata.get('offered_qos_profiles', ''),
            )
    heads = np.frombuffer(b''.join(heads), MESSAGE_HEADER)
    known = np.isin(heads['channel'], list(topics))
    if not known.all():
        heads, payloads = heads[known], [d for d, k in zip(payloads, known) if k]
    return Contents(
        topics,
        **{
            name: np.minimum(heads[name], np.uint64(LATEST_NS)).astype(np.int64)
            for name in MESSAGE_HEADER.names
        },
        payloads=payloads,
        records=records,
        damage=tuple(damage),
        nameless=len(known) - len(heads),
        indexed=indexed,
    )


def _parse(opcode, body):
    """Return a record of RECORDS; None for another one, and for one that is not as long."""
    stream = ReadDataStream(BytesIO(body))
    try:
        record = RECORDS[opcode].read(stream)
    except (KeyError, struct.error, UnicodeDecodeError, McapError):
        return None
    return record if stream.count == len(body) else None
