"""The steps of a recipe in a page: lines that a reader puts into files of the repository."""

import re
from pathlib import Path

PLACE = re.compile(r'in (?P<file>\S+), (?P<how>before|after|replace): (?P<anchor>.+)')
NEW_FILE = 'new file: '


def apply(step: str, text: str, folder: Path) -> None:
    """Apply a step to the files below `folder`.

    `new file: NAME` writes the text; `in FILE, after: ANCHOR` (or before) puts it beside the first
    line with ANCHOR, and `replace` puts it in the place of ANCHOR. Raises AssertionError for
    another step, and where no line has ANCHOR.
    """
    if step.startswith(NEW_FILE):
        (folder / step.removeprefix(NEW_FILE)).write_text(text)
        return
    place = PLACE.fullmatch(step)
    assert place, f'no step of a recipe: {step}'
    _edit(folder / place['file'], place['how'], place['anchor'], text)


def _edit(file, how, anchor, text):
    lines = file.read_text().splitlines(keepends=True)
    at = [k for k, line in enumerate(lines) if anchor in line]
    assert at, f'{file.name} has no line with {anchor!r}'
    first = at[0]
    if how == 'replace':
        lines[first] = lines[first].replace(anchor, text.strip())
    else:
        lines.insert(first + (how == 'after'), text)
    file.write_text(''.join(lines))
