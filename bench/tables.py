"""Tables once, for the terminal (rich) and for Markdown alike."""

from typing import NamedTuple

from rich import box
from rich.console import Console
from rich.table import Table


class Sheet(NamedTuple):
    """A table of texts; the first column stands left, the others right."""

    title: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]]
    note: str = ''


def show(console: Console, sheet: Sheet) -> None:
    """Print a table."""
    table = Table(title=sheet.title, title_justify='left', box=box.SIMPLE, caption=sheet.note)
    table.caption_justify = 'left'
    for i, name in enumerate(sheet.columns):
        table.add_column(name, justify='right' if i else 'left')
    for row in sheet.rows:
        table.add_row(*row)
    console.print(table)


def markdown(sheet: Sheet) -> str:
    """Return a table as Markdown."""
    rule = ['---'] + ['---:'] * (len(sheet.columns) - 1)
    lines = [_line(row) for row in (sheet.columns, rule, *sheet.rows)]
    note = [sheet.note, ''] if sheet.note else []
    return '\n'.join([f'## {sheet.title}', '', *lines, '', *note])


def _line(cells):
    return f'| {" | ".join(cells)} |'


def number(value: float) -> str:
    """Return a time or a ratio with three significant digits."""
    digits = 0 if value >= 100 else 1 if value >= 10 else 2 if value >= 1 else 3
    return f'{value:.{digits}f}'


def share(value: float) -> str:
    """Return a rate in per cent; 100 % only where it is all."""
    return '100 %' if value == 1 else f'{min(100 * value, 99.9):.1f} %'
