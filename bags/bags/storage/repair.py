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

import yaml

from bags.errors import BagError
from bags.storage.contents import Contents, load, mcap_path
from bags.storage.mcap_file import McapFile
from bags.storage.rosbag2_layout import Span, metadata
from bags.storage.rosbag2_writer import METADATA, mcap_name, write_metadata
from bags.storage.scan import Damage
from msgs_yaml.stamp import NS_PER_S

DRAFT = '.repaired'
KEPT = '.damaged'


class Repair(NamedTuple):
    """What was found and done."""

    path: Path  # of the MCAP file
    intact: bool  # the file was complete and is as it was
    kept: Path | None  # where the damaged file is now
    wrote_metadata: bool  # metadata.yaml was missing or spoke of other contents
    damage: tuple[Damage, ...]  # in file order
    messages: dict[str, int]  # recovered, per topic
    last_ns: int  # log time of the last one, 0 without messages
    nameless: int  # messages given up because nothing says what they are


def repair(path: Path | str) -> Repair:
    """Rebuild summary, footer and metadata.yaml of a bag (its folder or its MCAP file).

    A complete file stays untouched. Raises BagError when it is no bag, nothing can be recovered,
    or the new file cannot be written; the damaged file is then as it was.
    """
    file = mcap_path(path)
    found = load(file)
    if not found.topics:
        raise BagError(f'{file}: nothing can be recovered: no topic is described in it')
    intact = found.indexed and not found.damage
    kept = None if intact else _replace(file, found)
    times = [message.log_ns for message in found.messages] or [0]
    span = Span(len(found.messages), min(times), max(times))
    counts = Counter(found.topics[message.channel].name for message in found.messages)
    information = metadata(file.name, found.topics.values(), counts, span)
    return Repair(
        path=file,
        intact=intact,
        kept=kept,
        wrote_metadata=_complete_folder(file.parent, information, Path(path).is_dir()),
        damage=found.damage,
        messages={topic.name: counts[topic.name] for topic in found.topics.values()},
        last_ns=span.last_ns,
        nameless=found.nameless,
    )


def _replace(file, found):
    """Write the new file, then let it take the place of the damaged one; return where that is."""
    draft = file.with_name(file.name + DRAFT)
    try:
        draft.unlink(missing_ok=True)
        _write(draft, file.name, found)
        kept = _unused(file.with_name(file.name + KEPT))
        _second_name(file, kept)
        os.replace(draft, file)
    except (OSError, BagError) as error:
        draft.unlink(missing_ok=True)
        raise BagError(f'{file}: cannot be repaired: {error}; it is as it was') from error
    return kept


def _write(draft, name, found: Contents):
    index = {channel: i for i, channel in enumerate(found.topics)}
    records = {key: values for key, values in found.records.items() if key != 'rosbag2'}
    new = McapFile(draft, list(found.topics.values()), records, name)
    for channel, sequence, log_ns, publish_ns, data in found.messages:
        new.write(index[channel], log_ns, publish_ns, data, sequence)
    new.close()


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
    (file_name,) = information['relative_file_paths']
    if not is_bag and file_name != mcap_name(folder):
        return False
    try:
        text = (folder / METADATA).read_text(encoding='utf-8')
        written = yaml.safe_load(text)['rosbag2_bagfile_information']
        if all(written[key] == information[key] for key in ('message_count', 'starting_time')):
            return False
    except (OSError, ValueError, KeyError, TypeError, yaml.YAMLError):
        pass
    write_metadata(folder, information)
    return True


def report(done: Repair) -> str:
    """Return what was found and done, for a person."""
    if done.intact:
        text = f'{done.path}: complete, nothing to repair'
        return f'{text} but {METADATA}, which is written' if done.wrote_metadata else text
    lines = [f'{done.path}: repaired; the damaged file is kept as {done.kept.name}']
    lines += [f'  damage at byte {where.offset}: {where.what}' for where in done.damage]
    if done.nameless:
        lines.append(f'  {done.nameless} messages given up: their topic is described nowhere')
    lines.append(
        f'  recovered {sum(done.messages.values())} messages, '
        f'the last of time {done.last_ns / NS_PER_S:.9f} s'
    )
    width = max(map(len, done.messages))
    lines += [f'    {name:<{width}} {count:>8}' for name, count in done.messages.items()]
    return '\n'.join(lines)
