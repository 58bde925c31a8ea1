"""Tables and headings in MyST Markdown."""

import re
from collections.abc import Iterable, Sequence

CODE = re.compile(r'(`[^`]*`)')
SPECIAL = re.compile(r'([\\*_<>$\[\]|~#^{}])')


def text(words: str) -> str:
    """Return plain text with its markup escaped; what is in backticks stays code."""
    parts = CODE.split(' '.join(str(words).split()))
    return ''.join(
        part.replace('|', r'\|') if k % 2 else SPECIAL.sub(r'\\\1', part)
        for k, part in enumerate(parts)
    )


def code(words: object) -> str:
    """Return a text as code, also in a table; '' for none."""
    return f'`{words!s}`'.replace('|', r'\|') if str(words) else ''


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of cells that are Markdown already; columns that are empty are left out."""
    rows = [[str(cell) for cell in row] for row in rows]
    kept = [k for k, _ in enumerate(heads) if any(row[k] for row in rows)]
    lines = [[heads[k] for k in kept], ['---'] * len(kept), *([r[k] for k in kept] for r in rows)]
    return '\n'.join(f'| {" | ".join(cells)} |' for cells in lines) + '\n'


def number(value: float) -> str:
    """Return a bound as text."""
    return f'{value:g}'
