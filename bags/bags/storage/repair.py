"""Rebuild a complete bag from what a killed recorder or a broken disk left.

Everything that can be read is written into a new file, which then replaces the damaged one; that
one is kept under another name. Chunks count when their checksum agrees; of a chunk that was cut
off, everything that can be decompressed.
"""

import itertools
import os
import shutil
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml

from bags.errors import BagError
from bags.storage.bag_writer import INFORMATION, METADATA, McapFile, mcap_name, write_metadata
from bags.storage.mcap_reader import EMPTY_FILE, Damage, mcap_files, missing_before, read_mcap
from bags.storage.rosbag2_metadata import YAML_ERRORS, FileFacts, build_metadata
from msgs_yaml.conversions import NS_PER_S

COMPARED = ('message_count', 'starting_time', 'relative_file_paths')
DRAFT = '.repaired'
KEPT = '.damaged'


class FileRepair(NamedTuple):
    """The damage of one file and its repair."""

    path: Path
    kept: Path | None  # the damaged file, None when it was complete
    damage: tuple[Damage, ...]  # in file order
    facts: FileFacts  # contents of the file after the repair
    nameless: int  # messages left out because no channel describes them


class Repair(NamedTuple):
    """The damage of a bag and its repair."""

    path: Path  # of the MCAP file, of the folder when there are several
    files: tuple[FileRepair, ...]
    missing: tuple[str, ...]  # names of missing files of a split bag
    wrote_metadata: bool  # metadata.yaml was missing or of other contents
    messages: dict[str, int]  # per topic, after the repair

    @property
    def intact(self) -> bool:
        """Whether every file was complete and is unchanged."""
        return not self.missing and all(file.kept is None for file in self.files)

    @property
    def last_ns(self) -> int:
        """Log time of the last message, 0 without messages."""
        return max(file.facts.last_ns for file in self.files)


def repair_bag(path: Path | str) -> Repair:
    """Rebuild summary, footer and metadata.yaml of a bag (its folder or one MCAP file).

    A complete file stays untouched. A file of a split bag that describes no topic becomes an
    empty one. Raises BagError when it is no bag, nothing can be recovered, or a new file cannot be
    written; the damaged file is then unchanged.
    """
    files = mcap_files(path)
    bag_path = files[0] if len(files) == 1 else Path(path)
    contents = [
        read_mcap(file) if len(files) == 1 or file.stat().st_size else EMPTY_FILE for file in files
    ]
    topics = {topic.name: topic for file in contents for topic in file.topics.values()}
    if not topics:
        raise BagError(f'{bag_path}: nothing can be recovered: no topic is described in it')
    described, repaired = tuple(topics.values()), []
    for file, content in zip(files, contents):
        kept = None
        if not content.indexed or content.damage:
            kept = _replace(file, content, described)
        counts = Counter(content.topics[channel].name for channel in content.channel.tolist())
        times = content.log_ns if len(content.log_ns) else np.zeros(1, dtype=np.int64)
        facts = FileFacts(file.name, int(times.min()), int(times.max()), counts)
        repaired.append(FileRepair(file, kept, content.damage, facts, content.nameless))
    information = build_metadata(described, [file.facts for file in repaired])
    counts = sum((file.facts.counts for file in repaired), Counter())
    folder, wrote_metadata = files[0].parent, False
    if Path(path).is_dir() or [*folder.glob('*.mcap')] == [folder / mcap_name(folder)]:
        try:
            written = yaml.safe_load((folder / METADATA).read_text(encoding='utf-8'))[INFORMATION]
            wrote_metadata = any(written[key] != information[key] for key in COMPARED)
        except (OSError, TypeError, *YAML_ERRORS):
            wrote_metadata = True
    if wrote_metadata:
        write_metadata(folder, information)
    return Repair(
        path=bag_path,
        files=tuple(repaired),
        missing=tuple(filter(None, map(missing_before, files[1:], files))),
        wrote_metadata=wrote_metadata,
        messages={topic.name: counts[topic.name] for topic in described},
    )


def _replace(file, contents, described):
    """Replace a file by its rebuilt version; return the path of the damaged one."""
    draft = file.with_name(file.name + DRAFT)
    try:
        draft.unlink(missing_ok=True)
        topics = list(contents.topics.values()) or described
        records = {key: values for key, values in contents.records.items() if key != 'rosbag2'}
        new = McapFile(draft, topics, records, file.name)
        index = {channel: i for i, channel in enumerate(contents.topics)}
        columns = (contents.channel, contents.log_ns, contents.publish_ns, contents.sequence)
        rows = zip(*(column.tolist() for column in columns), contents.payloads)
        for channel, log_ns, publish_ns, sequence, data in rows:
            new.write(index[channel], log_ns, publish_ns, data, sequence)
        new.close({})
        # an earlier repair may have left a file there
        numbers = itertools.chain([''], itertools.count(2))
        names = (f'{file.name}{KEPT}{number}' for number in numbers)
        kept = next(path for path in map(file.with_name, names) if not path.exists())
        try:
            os.link(file, kept)
        except OSError:  # a file system without hard links
            shutil.copy2(file, kept)
        os.replace(draft, file)
    except (OSError, BagError) as error:
        draft.unlink(missing_ok=True)
        raise BagError(f'{file}: cannot be repaired: {error}; it is unchanged') from error
    return kept


def describe_repair(repair: Repair) -> str:
    """Return damage and repair of a bag as text for a person."""
    if repair.intact:
        text = f'{repair.path}: complete, nothing to repair'
        return f'{text} but {METADATA}, which is written' if repair.wrote_metadata else text
    lines = []
    for file in repair.files:
        if file.kept is not None:
            lines.append(f'{file.path}: repaired; the damaged file is kept as {file.kept.name}')
            lines += [f'  damage at byte {where.offset}: {where.what}' for where in file.damage]
        if file.nameless:
            lines.append(f'  {file.nameless} messages left out: no channel describes their topic')
    lines += [f'{repair.path}: {name} is missing' for name in repair.missing]
    lines.append(
        f'  recovered {sum(repair.messages.values())} messages, '
        f'the last of time {repair.last_ns / NS_PER_S:.9f} s'
    )
    width = max(map(len, repair.messages))
    lines += [f'    {name:<{width}} {count:>8}' for name, count in repair.messages.items()]
    return '\n'.join(lines)
