"""Write raw CDR into a rosbag2 folder: `<folder>/metadata.yaml`, `<folder>/<name>_0.mcap`, _1 ...

The files are crash-safe: what was flushed is a sequence of complete zstd chunks, from which
`bags repair` rebuilds summary and metadata.yaml.
"""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from mcap.writer import CompressionType, Writer

from bags.errors import BagError
from bags.storage.rosbag2_metadata import BagTopic, FileFacts, build_metadata, dump

CHUNK_BYTES = 768 * 1024  # default of rosbag2


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
        self._counts = Counter()  # messages by topic
        self.first_ns = self._last_ns = None  # log times of the messages written
        self._stream = _WholeWrites(path)
        self._writer = Writer(
            self._stream,
            chunk_size=CHUNK_BYTES,
            compression=CompressionType.ZSTD,
            enable_data_crcs=True,  # records between the chunks have no other checksum
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

        `sequence` is the publisher's count, 0 where unknown.
        """
        self._writer.add_message(self._channels[topic], log_ns, data, publish_ns, sequence)
        self._counts[self.topics[topic].name] += 1
        if self.first_ns is None:
            self.first_ns = self._last_ns = log_ns
        elif log_ns > self._last_ns:
            self._last_ns = log_ns
        elif log_ns < self.first_ns:
            self.first_ns = log_ns

    def flush(self):
        """Close the current chunk and pass it to the operating system."""
        self._writer.flush()

    def close(self, records: Mapping[str, Mapping[str, str]]) -> FileFacts:
        """Write further records, summary and footer; return what metadata.yaml says of the file."""
        facts = FileFacts(self._name, self.first_ns or 0, self._last_ns or 0, self._counts)
        self._writer.flush()
        for record, values in records.items():
            self._writer.add_metadata(record, dict(values))
        embedded = dump(build_metadata(self.topics, [facts]))
        self._writer.add_metadata('rosbag2', {'serialized_metadata': embedded})
        self._writer.finish()
        self._stream.close()
        return facts

    @property
    def size(self) -> int:
        """Bytes in the file, without the current chunk."""
        return self._stream.tell()


class _WholeWrites:
    """A file that contains every write completely or not at all.

    `mcap.writer` writes whole records, so a full disk never leaves half a record.
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
        """Do nothing: writes are not buffered here."""

    def close(self):
        try:
            os.fsync(self._file.fileno())
            self._file.close()
        except OSError as error:
            raise BagError(f'{self.path}: cannot be completed: {error.strerror}') from error


METADATA = 'metadata.yaml'
INFORMATION = 'rosbag2_bagfile_information'  # its only key; the record in a file lacks it


def mcap_name(folder: Path, number: int = 0) -> str:
    """Return the name of an MCAP file that rosbag2 expects in `folder`."""
    return f'{folder.name}_{number}.mcap'


def write_metadata(folder: Path, information: dict):
    """Write metadata.yaml atomically: the old file or the new one, never a part."""
    path = folder / METADATA
    draft = folder / f'.{METADATA}.{os.getpid()}'
    try:
        draft.write_text(dump({INFORMATION: information}), encoding='utf-8')
        os.replace(draft, path)
    except OSError as error:
        draft.unlink(missing_ok=True)
        raise BagError(f'{path}: {error.strerror}; what was recorded is complete') from error


class BagWriter:
    """Writes one bag into a folder that must not exist yet.

    `records` are MCAP metadata records {name: {key: text}}; each file begins with them. The bag
    continues in another file when one has `split_bytes` on the disk, without one chunk and the
    summary, or holds `split_ns` of log time; 0: never. Raises BagError when the folder exists or
    cannot be created, and when the disk fails.
    """

    def __init__(
        self,
        folder: Path | str,
        topics: Sequence[BagTopic],
        records: Mapping[str, Mapping[str, str]],
        split_bytes: int = 0,
        split_ns: int = 0,
    ):
        self.folder = Path(folder).absolute()
        try:
            self.folder.mkdir(parents=True)
        except FileExistsError as error:
            raise BagError(
                f'{self.folder}: exists already; a recording never goes into an old folder'
            ) from error
        except OSError as error:
            raise BagError(f'{self.folder}: cannot be created: {error.strerror}') from error
        self.topics = tuple(topics)
        self._records, self._split_bytes, self._split_ns = records, split_bytes, split_ns
        self._closed: list[FileFacts] = []
        self._file = self._next_file()

    def _next_file(self):
        path = self.folder / mcap_name(self.folder, len(self._closed))
        return McapFile(path, self.topics, self._records)

    def write(self, topic: int, log_ns: int, publish_ns: int, data: bytes, sequence: int = 0):
        """Append a message to the topic of this index; CDR with its encapsulation header.

        `sequence` is the publisher's count, 0 where unknown.
        """
        began_ns = self._file.first_ns
        if began_ns is not None and (
            0 < self._split_bytes <= self._file.size or 0 < self._split_ns <= log_ns - began_ns
        ):
            self._closed.append(self._file.close({}))
            self._file = self._next_file()
        self._file.write(topic, log_ns, publish_ns, data, sequence)

    def flush(self):
        """Close the current chunk and pass it to the operating system."""
        self._file.flush()

    def close(self, records: Mapping[str, Mapping[str, str]] = MappingProxyType({})) -> int:
        """Complete the bag with further records, write metadata.yaml, return how many messages."""
        self._closed.append(self._file.close(records))
        information = build_metadata(self.topics, self._closed)
        write_metadata(self.folder, information)
        return information['message_count']
