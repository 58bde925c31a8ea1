"""One MCAP file in the form rosbag2 expects, written so that a crash leaves whole records."""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from mcap.writer import CompressionType, Writer

from bags.errors import BagError
from bags.storage.rosbag2_layout import BagTopic, FileFacts, Span, embedded_text, metadata

CHUNK_BYTES = 768 * 1024  # rosbag2's own default


class McapFile:
    """Writes messages of known topics; `write` takes the index of a topic in `topics`.

    `records` are MCAP metadata records {name: {key: text}}; they and the file header are on the
    disk when the constructor returns. `name` is the name that the embedded metadata gives the
    file, should it be written under another one first. Raises BagError when the file exists or
    the disk fails: what was flushed before stays there, complete.
    """

    def __init__(
        self,
        path: Path,
        topics: Sequence[BagTopic],
        records: Mapping[str, Mapping[str, str]],
        name: str | None = None,
    ):
        self.topics = tuple(topics)
        self._name = name or path.name
        self._counts = [0] * len(self.topics)
        self.first_ns = self._last_ns = None  # log times of the messages written
        self._stream = _WholeWrites(path)
        self._writer = Writer(
            self._stream,
            chunk_size=CHUNK_BYTES,
            compression=CompressionType.ZSTD,
            enable_data_crcs=True,  # what lies between the chunks has no other checksum
        )
        self._writer.start(profile='ros2', library='bags')
        for record, values in records.items():
            self._writer.add_metadata(record, dict(values))
        schemas = {
            type_name: self._writer.register_schema(type_name, 'ros2msg', text.encode())
            for type_name, text in {topic.type: topic.schema for topic in self.topics}.items()
        }
        self._channels = [
            self._writer.register_channel(
                topic=topic.name,
                message_encoding='cdr',
                schema_id=schemas[topic.type],
                metadata={'offered_qos_profiles': topic.qos, 'topic_type_hash': topic.type_hash},
            )
            for topic in self.topics
        ]

    def write(self, topic: int, log_ns: int, publish_ns: int, data: bytes, sequence: int = 0):
        """Append one message: CDR with its encapsulation header, times in ns.

        `sequence` is the publisher's own count, 0 where unknown.
        """
        self._writer.add_message(self._channels[topic], log_ns, data, publish_ns, sequence)
        self._counts[topic] += 1
        if self.first_ns is None:
            self.first_ns = self._last_ns = log_ns
        elif log_ns > self._last_ns:
            self._last_ns = log_ns
        elif log_ns < self.first_ns:
            self.first_ns = log_ns

    def flush(self):
        """Close the chunk in progress and hand it to the operating system."""
        self._writer.flush()

    def close(self, records: Mapping[str, Mapping[str, str]]) -> FileFacts:
        """Write further records, summary and footer; return what metadata.yaml says of the file."""
        facts = FileFacts(self._name, self.span, self.counts)
        self._writer.flush()
        for record, values in records.items():
            self._writer.add_metadata(record, dict(values))
        embedded = embedded_text(metadata(self.topics, [facts]))
        self._writer.add_metadata('rosbag2', {'serialized_metadata': embedded})
        self._writer.finish()
        self._stream.close()
        return facts

    @property
    def size(self) -> int:
        """Bytes in the file, without the chunk in progress."""
        return self._stream.tell()

    @property
    def counts(self) -> Counter[str]:
        """Messages written so far per topic."""
        counts = Counter()
        for topic, n in zip(self.topics, self._counts):
            counts[topic.name] += n
        return counts

    @property
    def span(self) -> Span:
        """Number of messages and their first and last log time, zeros for none."""
        return Span(sum(self._counts), self.first_ns or 0, self._last_ns or 0)


class _WholeWrites:
    """A file that holds every write completely or not at all.

    `mcap.writer` passes whole records to each write; so a full disk never leaves half a record.
    """

    def __init__(self, path):
        self.path = path
        self._size = 0
        try:
            self._file = open(path, 'xb', buffering=0)  # noqa: SIM115 - lives as long as the bag
        except OSError as error:
            raise BagError(f'{path}: cannot be created: {error.strerror}') from error

    def write(self, data):
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            os.ftruncate(self._file.fileno(), self._size)
            self._file.seek(self._size)
            raise BagError(
                f'{self.path}: {error.strerror}; the first {self._size} bytes are kept, '
                f'`bags repair {self.path.parent}` makes a complete bag of them'
            ) from error
        self._size += len(data)
        return len(data)

    def tell(self):
        return self._size

    def flush(self):
        """Writes are not buffered here."""

    def close(self):
        try:
            os.fsync(self._file.fileno())
            self._file.close()
        except OSError as error:
            raise BagError(f'{self.path}: cannot be completed: {error.strerror}') from error
