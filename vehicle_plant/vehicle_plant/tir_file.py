"""The text of a tyre property file: `[SECTION]`, `KEY = value`, comments from `$` or `!` on.

Case does not matter, except inside quotes, and neither do tabs or the order of sections. Tables (a
`{header}` and rows of numbers) are passed over.
"""

import re
from pathlib import Path
from typing import NamedTuple

from node_runtime.parameters import ParameterError

_SECTION = re.compile(r'\[\s*([^\]]+?)\s*\]$')
_ENTRY = re.compile(r'([A-Za-z_]\w*)\s*=\s*(.*)$')
_TABLE = re.compile(r'\{.*\}$|[-+.\deEdD\s,]+$')
_COMMENT = re.compile(r"""('[^']*'|"[^"]*")|[$!].*""")


class Entry(NamedTuple):
    """A value as it is written, without quotes, and its line."""

    text: str
    line: int


class TirFile(NamedTuple):
    """Sections by name in capitals; each has its entries by key in capitals, and its line."""

    path: Path
    sections: dict[str, dict[str, Entry]]
    lines: dict[str, int]

    def find(self, key: str) -> Entry | None:
        """Return an entry of any section but UNITS, whose keys are also those of masses."""
        for name, entries in self.sections.items():
            if name != 'UNITS' and key in entries:
                return entries[key]
        return None

    def error(self, line: int | None, what: str) -> ParameterError:
        """Return the error that says where and what."""
        return ParameterError(f'{self.path}:{line}: {what}' if line else f'{self.path}: {what}')


def read(path: Path) -> TirFile:
    """Read a property file. Raises ParameterError that names file and line, and OSError."""
    file = TirFile(Path(path), {}, {})
    section = ''
    # comments of old files are in no known encoding; keys and numbers are ASCII
    for line, raw in enumerate(file.path.read_text(encoding='latin-1').splitlines(), start=1):
        text = _COMMENT.sub(lambda found: found[1] or '', raw).strip()
        if found := _SECTION.match(text):
            section = found[1].upper()
            file.lines.setdefault(section, line)
            file.sections.setdefault(section, {})
        elif found := _ENTRY.match(text):
            _add(file, section, found[1].upper(), Entry(found[2].strip('\'" \t'), line))
        elif text and not _TABLE.match(text):
            raise file.error(line, f'{text!r} is no section, no KEY = value and no table')
    return file


def _add(file, section, key, entry):
    entries = file.sections.setdefault(section, {})
    if key in entries:
        raise file.error(entry.line, f'{key}: is there already, in line {entries[key].line}')
    entries[key] = entry
