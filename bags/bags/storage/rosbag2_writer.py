"""Raw CDR in, a rosbag2 folder out: `<folder>/metadata.yaml` and `<folder>/<name>_0.mcap`, _1 ...

The files are safe against a crash of their writer: whatever was flushed is a sequence of complete
zstd chunks, from which `bags repair` rebuilds summary and metadata.yaml.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from bags.errors import BagError
from bags.storage.mcap_file import McapFile
from bags.storage.rosbag2_layout import BagTopic, FileFacts, Span, file_text, metadata

METADATA = 'metadata.yaml'


class Split(NamedTuple):
    """When a bag goes on in another file; 0: never."""

    bytes: int = 0  # on the disk; one chunk and the summary come on top
    duration_ns: int = 0  # of log time


WHOLE = Split()


def mcap_name(folder: Path, number: int = 0) -> str:
    """Name of an MCAP file that rosbag2 expects in `folder`."""
    return f'{folder.name}_{number}.mcap'


def write_metadata(folder: Path, information: dict):
    """Write metadata.yaml in one step: there is the old file or the new one, never half of it."""
    path = folder / METADATA
    draft = folder / f'.{METADATA}.{os.getpid()}'
    try:
        draft.write_text(file_text(information), encoding='utf-8')
        os.replace(draft, path)
    except OSError as error:
        draft.unlink(missing_ok=True)
        raise BagError(f'{path}: {error.strerror}; what was recorded is complete') from error


class BagWriter:
    """Writes one bag into a folder that must not exist yet.

    `records` are MCAP metadata records {name: {key: text}}; each file begins with them. Raises
    BagError when the folder exists or cannot be made, and when the disk fails.
    """

    def __init__(
        self,
        folder: Path | str,
        topics: Sequence[BagTopic],
        records: Mapping[str, Mapping[str, str]],
        split: Split = WHOLE,
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
        self._records, self._split = records, split
        self._closed: list[FileFacts] = []
        self._file = self._next_file()

    def _next_file(self):
        path = self.folder / mcap_name(self.folder, len(self._closed))
        return McapFile(path, self.topics, self._records)

    def write(self, topic: int, log_ns: int, publish_ns: int, data: bytes, sequence: int = 0):
        """Append a message to the topic of this index; CDR with its encapsulation header.

        `sequence` is the publisher's own count, 0 where unknown. Goes on in another file where
        the split says so.
        """
        if self._is_full(log_ns):
            self._closed.append(self._file.close({}))
            self._file = self._next_file()
        self._file.write(topic, log_ns, publish_ns, data, sequence)

    def _is_full(self, log_ns):
        file, split = self._file, self._split
        if split.bytes and file.size >= split.bytes and file.first_ns is not None:
            return True
        if split.duration_ns and file.first_ns is not None:
            return log_ns - file.first_ns >= split.duration_ns
        return False

    def flush(self):
        """Close the chunk in progress and hand it to the operating system."""
        self._file.flush()

    def close(self, records: Mapping[str, Mapping[str, str]] = MappingProxyType({})) -> Span:
        """Complete the bag with further records, write metadata.yaml, return what was recorded."""
        self._closed.append(self._file.close(records))
        information = metadata(self.topics, self._closed)
        write_metadata(self.folder, information)
        first_ns = information['starting_time']['nanoseconds_since_epoch']
        last_ns = first_ns + information['duration']['nanoseconds']
        return Span(information['message_count'], first_ns, last_ns)
