"""Read the MCAP files of a bag into arrays, however damaged they are, and locate the damage.

A bag is one file, or several numbered ones when it was split. Format: https://mcap.dev/spec. Only
chunks carry a checksum, so they are located by signature, wherever they are, and accepted by CRC;
the records between them are walked from one chunk to the next, and from the last one to the
summary, which the footer locates. So a broken record costs those up to the next chunk or to the
summary, and no chunk other than its own.
"""

import re
import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from bags.errors import BagError
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
RECORD_PREFIX = struct.Struct('<BQ')  # opcode, length of the body
CHUNK_HEADER = struct.Struct('<QQQII')  # first and last time, size, checksum, codec's length
SIZE = struct.Struct('<Q')  # of the compressed bytes
CODEC = re.compile(rb'\x04\x00\x00\x00zstd|\x03\x00\x00\x00lz4')  # with its length before it
CODEC_AT = RECORD_PREFIX.size + CHUNK_HEADER.size - 4  # where that length lies in a chunk record
DATA_END = CHECKSUM = struct.Struct('<I')  # 0 without a checksum
FOOTER = struct.Struct('<QQI')  # begin of the summary, of its offsets, checksum
LARGEST_CHUNK = 1 << 30  # bytes; a larger size is damage
UNKNOWN_SIZE = -1  # `frame_content_size` of a frame without its size


class Record(NamedTuple):
    """A record; the body of a chunk is decompressed."""

    offset: int  # in the file
    opcode: int
    body: bytes
    checked: bool  # its CRC is valid


class Damage(NamedTuple):
    """From `offset` on, up to the next chunk, nothing is readable."""

    offset: int
    what: str


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
    if not whole and not data.startswith(MCAP0_MAGIC):
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
        own = [(item.opcode, item.body)]
        for opcode, body in records_in_chunk(item.body) if is_chunk else own:
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
    heads = np.frombuffer(b''.join(heads), MESSAGE_HEADER)
    used = {*heads['channel'].tolist()}
    vouched = {
        c.topic for (opcode, _), (c, ok) in defined.items() if opcode == Opcode.CHANNEL and ok
    }
    topics = {}
    for (opcode, number), (channel, checked) in sorted(defined.items(), key=lambda item: item[0]):
        schema, _ = defined.get((Opcode.SCHEMA, getattr(channel, 'schema_id', 0)), (None, False))
        if opcode != Opcode.CHANNEL or not schema or channel.message_encoding != 'cdr':
            continue
        # beside channels with a checksum one without it is taken for a damaged copy of another,
        # unless messages have its number and no other channel has its topic
        if vouched and not checked and (channel.topic in vouched or number not in used):
            continue
        topics[number] = BagTopic(
            name=channel.topic,
            type=schema.name,
            schema=schema.data.decode('utf-8', 'replace'),
            type_hash=channel.metadata.get('topic_type_hash', ''),
            qos=channel.metadata.get('offered_qos_profiles', ''),
        )
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


def scan_records(data: bytes) -> Iterator[Record | Damage]:
    """Yield the records of a file in file order, and its damage in between.

    The last thing is a Damage unless the file ends as a closed file does. Never raises.
    """
    position = len(MCAP0_MAGIC)
    if not data.startswith(MCAP0_MAGIC):
        yield Damage(0, 'it does not begin as an MCAP file')
    while (chunk := _next_chunk(data, position)) is not None:
        begin, end, contents = chunk
        yield from _between(data, position, begin)
        opcode, length = RECORD_PREFIX.unpack_from(data, begin)
        if opcode != Opcode.CHUNK or length != end - begin - RECORD_PREFIX.size:
            yield Damage(begin, 'the head of a chunk is wrong, its contents are not')
        yield Record(begin, Opcode.CHUNK, contents, True)
        position = end
    if (closing := _closing_at(data, position)) is not None:
        yield from _between(data, position, closing)
        position = closing
    yield from _between(data, position, len(data))


def records_in_chunk(contents: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield opcode and body of each whole record in a chunk."""
    position, size = 0, len(contents)
    while position + RECORD_PREFIX.size <= size:
        opcode, length = RECORD_PREFIX.unpack_from(contents, position)
        position += RECORD_PREFIX.size
        if position + length > size:
            return
        yield opcode, contents[position : position + length]
        position += length


def _closing_at(data, position):
    """Return where a closed file has the end of its data, before its summary; None without one."""
    footer = len(data) - len(MCAP0_MAGIC) - FOOTER.size - RECORD_PREFIX.size
    if footer < position or RECORD_PREFIX.unpack_from(data, footer) != (Opcode.FOOTER, FOOTER.size):
        return None
    summary, *_ = FOOTER.unpack_from(data, footer + RECORD_PREFIX.size)
    begin = summary - DATA_END.size - RECORD_PREFIX.size
    if not position <= begin <= footer:
        return None
    is_end = RECORD_PREFIX.unpack_from(data, begin) == (Opcode.DATA_END, DATA_END.size)
    return begin if is_end else None


def _between(data, position, end):
    """Yield the records between two chunks, or after the last."""
    closing = len(data) - len(MCAP0_MAGIC)
    seen = []
    while position < end:
        if position == closing and data[closing:] == MCAP0_MAGIC and seen[-1:] == [Opcode.FOOTER]:
            if Opcode.DATA_END not in seen:
                yield Damage(position, 'the end of the data is not marked')
            return
        if position + RECORD_PREFIX.size > end:
            yield Damage(position, 'the file is cut off inside a record')
            return
        opcode, length = RECORD_PREFIX.unpack_from(data, position)
        seen.append(opcode)
        body = position + RECORD_PREFIX.size
        if body + length > end:
            cut = end == len(data)
            yield Damage(position, 'the file is cut off inside a record' if cut else 'no record')
            if cut and opcode == Opcode.CHUNK:
                yield Record(position, opcode, _decompress_part(data[body:], length), False)
            return
        if opcode == Opcode.CHUNK:
            try:
                yield Record(position, opcode, *_chunk_contents(data[body : body + length]))
            except ValueError as error:
                yield Damage(position, str(error))
        else:
            yield from _check_section_crc(data, position, opcode, body, length)
            yield Record(position, opcode, data[body : body + length], False)
        position = body + length
    if end == len(data):
        yield Damage(end, 'the file is cut off: its footer is missing')


def _check_section_crc(data, position, opcode, body, length):
    """Yield a Damage where the CRC of the data section or of the summary is wrong."""
    if opcode == Opcode.DATA_END and length == DATA_END.size:
        (checksum,) = DATA_END.unpack_from(data, body)
        if checksum not in (0, zlib.crc32(data[:position])):
            yield Damage(position, 'the CRC of the data section is wrong')
    elif opcode == Opcode.FOOTER and length == FOOTER.size:
        begin, _, checksum = FOOTER.unpack_from(data, body)
        covered = data[begin or position : body + FOOTER.size - CHECKSUM.size]
        if checksum not in (0, zlib.crc32(covered)):
            yield Damage(position, 'the CRC of the summary is wrong')


def _next_chunk(data, position):
    """Return (begin, end, contents) of the first compressed chunk with a valid CRC, or None."""
    for match in CODEC.finditer(data, position):
        begin = match.start() - CODEC_AT
        if begin < position or match.end() + SIZE.size > len(data):
            continue
        # its length is written twice; where they differ, the CRC decides
        ends = (
            begin + RECORD_PREFIX.size + RECORD_PREFIX.unpack_from(data, begin)[1],
            match.end() + SIZE.size + SIZE.unpack_from(data, match.end())[0],
        )
        for end in dict.fromkeys(ends):
            try:
                contents, checked = _chunk_contents(data[begin + RECORD_PREFIX.size : end])
            except ValueError:
                continue
            if checked:
                return begin, end, contents
    return None


def _chunk_contents(body):
    """Return (contents, whether the CRC is valid) of a chunk; ValueError with what is wrong."""
    try:
        *_, size, checksum, codec_length = CHUNK_HEADER.unpack_from(body)
        codec = body[CHUNK_HEADER.size : CHUNK_HEADER.size + codec_length]
        data = body[CHUNK_HEADER.size + codec_length + SIZE.size :]
        if size > LARGEST_CHUNK:
            raise ValueError('the head of a chunk is wrong')
        if codec == b'zstd':
            # a frame that claims another size would get that much memory
            if zstandard.frame_content_size(data) not in (size, UNKNOWN_SIZE):
                raise ValueError('the head of a chunk is wrong')
            # one without a size is limited to that of the chunk: a megabyte may unpack to many
            unpack = zstandard.ZstdDecompressor().decompress
            contents = unpack(data, max_output_size=size, allow_extra_data=False)
        elif codec == b'lz4':
            frame = lz4.frame.LZ4FrameDecompressor()
            contents = frame.decompress(data, max_length=size + 1)
            if not frame.eof or frame.unused_data:
                raise ValueError('a chunk is not as long as its head says')
        elif codec == b'':
            contents = data
        else:
            raise ValueError(f'a chunk is compressed by {codec!r}, which is unknown')
    except (struct.error, zstandard.ZstdError, RuntimeError, MemoryError) as error:
        raise ValueError(f'a chunk is damaged: {error}') from error
    if len(contents) != size:
        raise ValueError('the head of a chunk is wrong')
    if checksum not in (0, zlib.crc32(contents)):
        raise ValueError('a chunk is damaged: its checksum disagrees')
    return contents, checksum != 0


def _decompress_part(body, length):
    """Return what can be decompressed of a zstd chunk of `length` bytes that was cut off."""
    try:
        *_, contained, _, codec_length = CHUNK_HEADER.unpack_from(body)
        codec = body[CHUNK_HEADER.size : CHUNK_HEADER.size + codec_length]
        data_at = CHUNK_HEADER.size + codec_length + SIZE.size
        (size,) = SIZE.unpack_from(body, data_at - SIZE.size)
        # both lengths of the chunk must exceed the file; one alone is a broken number
        if codec != b'zstd' or data_at + size != length:
            return b''
        frame = zstandard.ZstdDecompressor().stream_reader(body[data_at:])
        return frame.read(min(contained, LARGEST_CHUNK))
    except (struct.error, zstandard.ZstdError, MemoryError):
        return b''
