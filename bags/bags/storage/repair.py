"""Make a complete bag of what a killed recorder or a broken disk left.

Everything that can be read is written into a new file beside the damaged one, which is kept under
another name; only then does the new file take its place. Only chunks whose checksum agrees are
believed, and of a chunk that was cut off as much as can be decompressed.
"""

import os
import shutil
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml

from bags.errors import BagError
from bags.storage.bag_writer import METADATA, McapFile, mcap_name, write_metadata
from bags.storage.mcap_reader import EMPTY_FILE, Contents, mcap_files, missing_before, read_mcap
from bags.storage.mcap_scan import Damage
from bags.storage.rosbag2_metadata import YAML_ERRORS, FileFacts, Span, build_metadata
from msgs_yaml.conversions import NS_PER_S

COMPARED = ('message_count', 'starting_time', 'relative_file_paths')
DRAFT = '.repaired'
KEPT = '.damaged'


class FileRepair(NamedTuple):
    """What was found in one file, and done."""

    path: Path
    kept: Path | None  # where the damaged file is now, None when it was complete
    damage: tuple[Damage, ...]  # in file order
    facts: FileFacts  # what is in the file now
    nameless: int  # messages given up because nothing says what they are


class Repair(NamedTuple):
    """What was found in a bag, and done."""

    path: Path  # of the MCAP file, of the folder when there are several
    files: tuple[FileRepair, ...]
    missing: tuple[str, ...]  # names of files of a split bag that are not there
    wrote_metadata: bool  # metadata.yaml was missing or spoke of other contents
    messages: dict[str, int]  # that the bag has now, per topic

    @property
    def intact(self) -> bool:
        """Whether every file was complete and is as it was."""
        return not self.missing and all(file.kept is None for file in self.files)

    @property
    def last_ns(self) -> int:
        """Log time of the last message, 0 without messages."""
        return max(file.facts.span.last_ns for file in self.files)


def repair_bag(path: Path | str) -> Repair:
    """Rebuild summary, footer and metadata.yaml of a bag (its folder or one MCAP file).

    A complete file stays untouched. A file of a split bag that describes no topic becomes an
    empty one. Raises BagError when it is no bag, nothing can be recovered, or a new file cannot be
    written; the damaged file is then as it was.
    """
    files = mcap_files(path)
    place = files[0] if len(files) == 1 else Path(path)
    found = [
        read_mcap(file) if len(files) == 1 or file.stat().st_size else EMPTY_FILE for file in files
    ]
    topics = {topic.name: topic for one in found for topic in one.topics.values()}
    if not topics:
        raise BagError(f'{place}: nothing can be recovered: no topic is described in it')
    described = tuple(topics.values())
    done = [_one(file, contents, described) for file, contents in zip(files, found)]
    information = build_metadata(described, [file.facts for file in done])
    counts = sum((file.facts.counts for file in done), Counter())
    return Repair(
        path=place,
        files=tuple(done),
        missing=tuple(filter(None, map(missing_before, files[1:], files))),
        wrote_metadata=_complete_folder(files[0].parent, information, Path(path).is_dir()),
        messages={topic.name: counts[topic.name] for topic in described},
    )


def _one(file, found, described):
    kept = None
    if not found.indexed or found.damage:
        kept = _replace(file, found, described)
    times = found.log_ns if len(found.log_ns) else np.zeros(1, dtype=np.int64)
    counts = Counter(found.topics[channel].name for channel in found.channel.tolist())
    span = Span(len(found.payloads), int(times.min()), int(times.max()))
    return FileRepair(file, kept, found.damage, FileFacts(file.name, span, counts), found.nameless)


def _replace(file, found, described):
    """Write the new file, then let it take the place of the damaged one; return where that is."""
    draft = file.with_name(file.name + DRAFT)
    try:
        draft.unlink(missing_ok=True)
        _write(draft, file.name, found, described)
        kept = _unused(file.with_name(file.name + KEPT))
        _second_name(file, kept)
        os.replace(draft, file)
    except (OSError, BagError) as error:
        draft.unlink(missing_ok=True)
        raise BagError(f'{file}: cannot be repaired: {error}; it is as it was') from error
    return kept


def _write(draft, name, found: Contents, described):
    index = {channel: i for i, channel in enumerate(found.topics)}
    records = {key: values for key, values in found.records.items() if key != 'rosbag2'}
    new = McapFile(draft, list(found.topics.values()) or described, records, name)
    for channel, sequence, log_ns, publish_ns, data in found.messages:
        new.write(index[channel], log_ns, publish_ns, data, sequence)
    new.close({})


def _unused(path):
    """`path`, or with a number behind it when an earlier repair left a file there."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_name(f'{path.name}{number}')
    return free


def _second_name(file, kept):
    try:
        os.link(file, kept)
    except OSError:  # a file system without hard links
        shutil.copy2(file, kept)


def _complete_folder(folder, information, is_bag):
    """Write metadata.yaml into the folder of a bag unless it speaks of these messages already."""
    if not is_bag and information['relative_file_paths'] != [mcap_name(folder)]:
        return False
    try:
        text = (folder / METADATA).read_text(encoding='utf-8')
        written = yaml.safe_load(text)['rosbag2_bagfile_information']
        if all(written[key] == information[key] for key in COMPARED):
            return False
    except (OSError, TypeError, *YAML_ERRORS):
        pass
    write_metadata(folder, information)
    return True


def describe_repair(done: Repair) -> str:
    """Return what was found and done, for a person."""
    if done.intact:
        text = f'{done.path}: complete, nothing to repair'
        return f'{text} but {METADATA}, which is written' if done.wrote_metadata else text
    lines = []
    for file in done.files:
        if file.kept is not None:
            lines.append(f'{file.path}: repaired; the damaged file is kept as {file.kept.name}')
            lines += [f'  damage at byte {where.offset}: {where.what}' for where in file.damage]
        if file.nameless:
            lines.append(f'  {file.nameless} messages given up: their topic is described nowhere')
    lines += [f'{done.path}: {name} is missing' for name in done.missing]
    lines.append(
        f'  recovered {sum(done.messages.values())} messages, '
        f'the last of time {done.last_ns / NS_PER_S:.9f} s'
    )
    width = max(map(len, done.messages))
    lines += [f'    {name:<{width}} {count:>8}' for name, count in done.messages.items()]
    return '\n'.join(lines)
