"""Small MCAP files without checksums, and changes to one record of such a file, chunks included.

Lengths and checksums are recomputed, so that a change reaches the code behind their checks.
"""

import random
import re
import struct
import zlib
from collections.abc import Iterator
from io import BytesIO

import coverage_guided
import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, Schema
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer

from bags.storage import mcap_scan, read
from bags.storage.mcap_reader import MESSAGE_HEADER

KINDS = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.CHUNK: Chunk,
}
PACK = {'': bytes, 'lz4': lz4.frame.compress, 'zstd': zstandard.ZstdCompressor().compress}
UNPACK = {'': bytes, 'lz4': lz4.frame.decompress, 'zstd': zstandard.ZstdDecompressor().decompress}
BROKEN = (
    *(struct.error, ValueError, KeyError, OverflowError, RuntimeError, MemoryError),
    *(McapError, zstandard.ZstdError),
)
COMMENT = re.compile(rb'[ \t]*#.*|^\s*\n', re.MULTILINE)
CHUNKED = ('/vehicle/odometry', '/controller/command', '/controller/why')
QOS = '- {history: keep_last, depth: 1, reliability: reliable, durability: transient_local}'
LARGEST = 8_000  # bytes of a message: a longer one only costs time
WORDS = (
    *('bool', 'byte', 'char', 'wstring', 'string', 'int8', 'uint64', 'float32', 'float64', 'time'),
    *('[]', '[0]', '[3]', '[<=3]', '[4294967295]', '<=5', '=', '=1', '#', ' ', '\n', '-', '/', '_'),
    *('class', '_x', 'x', '9', 'header', 'stamp', 'sec', 'a/B', 'a/msg/B', 'std_msgs/Header'),
    *(f'\n{"=" * 80}\nMSG: a/B\n', 'B b\n', 'a/B[9] b\n', 'int32 x\n'),
    *('{}', '[]', '[[]]', '- {history: [1], depth: x}', '- 1', '&a [*a]', '2026-99-99', '? ', '!!'),
    *('keep_last', 'reliable', '/vehicle/odometry', '/controller/why', '/clock', 'cdr', 'rosbag2'),
)


def small_bags(bag: read.Bag) -> Iterator[bytes]:
    """Yield files with two messages of each topic: topic by topic, and several in chunks."""
    filled = [r for r in bag.recordings.values() if r.payloads and len(r.payloads[0]) < LARGEST]
    for recorded in filled:
        yield _file([recorded], use_chunking=False)
    few = [bag.recordings[name] for name in CHUNKED]
    yield _file(few, compression=CompressionType.NONE)
    yield _file(few, compression=CompressionType.ZSTD)


def _file(recordings, **options):
    stream = BytesIO()
    writer = Writer(stream, enable_crcs=False, **options)
    writer.start(profile='ros2', library='bags')
    writer.add_metadata('run', {'scenario': 'straight'})
    for topic, log_ns, publish_ns, sequence, payloads in recordings:
        schema = writer.register_schema(
            topic.type, 'ros2msg', COMMENT.sub(b'', topic.schema.encode())
        )
        noted = {'offered_qos_profiles': QOS, 'topic_type_hash': topic.type_hash}
        channel = writer.register_channel(topic.name, 'cdr', schema, noted)
        for i in (0, -1):
            times = int(log_ns[i]), payloads[i], int(publish_ns[i]), int(sequence[i])
            writer.add_message(channel, *times)
    writer.finish()
    return stream.getvalue()


def changed(data: bytes, choose: random.Random) -> bytes:
    """Return a file with one record changed, moved, doubled or left out."""
    magic = len(MCAP0_MAGIC)
    records = _several(data[magic:-magic], choose)
    return MCAP0_MAGIC + records + MCAP0_MAGIC


def _several(data, choose):
    records = [(opcode, data[begin:end]) for opcode, begin, end in mcap_scan.records_in_chunk(data)]
    if not records:
        return coverage_guided.mutate_bytes(data, choose)
    at = choose.randrange(len(records))
    how = choose.random()
    if how < 0.8:
        opcode, body = records[at]
        records[at] = opcode, _record(opcode, body, choose)
    elif how < 0.9:
        records.insert(choose.randrange(len(records)), records[at])
    else:
        moved = records.pop(at)
        if how < 0.95:
            records.insert(choose.randrange(len(records) + 1), moved)
    return b''.join(
        mcap_scan.RECORD_PREFIX.pack(opcode, len(body)) + body for opcode, body in records
    )


def _record(opcode, body, choose):
    if opcode == Opcode.MESSAGE:
        head = MESSAGE_HEADER.itemsize
        if choose.random() < 0.8:
            return body[:head] + coverage_guided.mutate_bytes(body[head:], choose)
    elif opcode in KINDS and choose.random() < 0.9:
        try:
            record = KINDS[opcode].read(ReadDataStream(BytesIO(body)))
            CHANGES[opcode](record, choose)
        except BROKEN:
            return coverage_guided.mutate_bytes(body, choose)
        built = RecordBuilder()
        record.write(built)
        return built.end()[mcap_scan.RECORD_PREFIX.size :]
    return coverage_guided.mutate_bytes(body, choose)


def _schema(record, choose):
    if choose.random() < 0.8:
        text = coverage_guided.mutate_text(record.data.decode('utf-8', 'ignore'), WORDS, choose)
        record.data = text.encode()
    else:
        record.name = coverage_guided.mutate_text(record.name, WORDS, choose)


def _channel(record, choose):
    if choose.random() < 0.2:
        record.topic = coverage_guided.mutate_text(record.topic, WORDS, choose)
    else:
        _values(record.metadata, choose)


def _values(noted, choose):
    name = choose.choice([*noted, 'offered_qos_profiles'])
    noted[name] = coverage_guided.mutate_text(noted.get(name, ''), WORDS, choose)


def _chunk(record, choose):
    inside = _several(UNPACK[record.compression](record.data), choose)
    record.compression = choose.choice([*PACK])
    record.data = PACK[record.compression](inside)
    record.uncompressed_size = len(inside)
    record.uncompressed_crc = choose.choice((0, zlib.crc32(inside)))


CHANGES = {
    Opcode.SCHEMA: _schema,
    Opcode.CHANNEL: _channel,
    Opcode.METADATA: lambda record, choose: _values(record.metadata, choose),
    Opcode.CHUNK: _chunk,
}
