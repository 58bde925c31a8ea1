"""Raw CDR in, a rosbag2 folder out: `<folder>/metadata.yaml` and `<folder>/<name>_0.mcap`.

The file is safe against a crash of its writer: whatever was flushed is a sequence of complete
zstd chunks, from which `bags repair` rebuilds summary and metadata.yaml.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from bags.errors import BagError
from bags.storage.mcap_file import McapFile
from bags.storage.rosbag2_layout import BagTopic, Span, file_text

METADATA = 'metadata.yaml'


def mcap_name(folder: Path) -> str:
    """Name of the MCAP file that rosbag2 expects in `folder`."""
    return f'{folder.name}_0.mcap'


def write_metadata(folder: Path, information: dict):
    """Write metadata.yaml in one step: there is the old file or the new one, never half of it."""
    path = folder / METADATA
    draft = folder / f'.{METADATA}.{os.getpid()}'
    try:
        draft.write_text(file_text(information), encoding='utf-8')
        os.replace(draft, path)
    except OSError as error:
        draft.unlink(missing_ok=True)
        raise BagError(f'{path}: {error.strerror}; the MCAP file itself is complete') from error


class BagWriter:
    """Writes one bag into a folder that must not exist yet.

    `write(topic, log_ns, publish_ns, data, sequence)` takes the index of a topic in `topics` and
    CDR with its encapsulation header; `flush()` closes the chunk in progress and hands it to the
    operating system. `records` are MCAP metadata records {name: {key: text}}. Raises BagError
    when the folder exists or cannot be made, and when the disk fails.
    """

    def __init__(
        self,
        folder: Path | str,
        topics: Sequence[BagTopic],
        records: Mapping[str, Mapping[str, str]],
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
        self._file = McapFile(self.folder / mcap_name(self.folder), topics, records)
        self.write = self._file.write
        self.flush = self._file.flush

    def close(self) -> Span:
        """Complete the file, write metadata.yaml, return what was recorded."""
        write_metadata(self.folder, self._file.close())
        return self._file.span
