"""Text tables for the terminal (rich) and for Markdown."""

from typing import NamedTuple

from rich import box
from rich.console import Console
from rich.table import Table


class TextTable(NamedTuple):
    """A table of texts; the first column is left-aligned, the others right-aligned."""

    title: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]]


def show(console: Console, text_table: TextTable) -> None:
    """Print a table."""
    table = Table(title=text_table.title, title_justify='left', box=box.SIMPLE)
    for i, name in enumerate(text_table.columns):
        table.add_column(name, justify='right' if i else 'left')
    for row in text_table.rows:
        table.add_row(*row)
    console.print(table)


def markdown(text_table: TextTable) -> str:
    """Return a table as Markdown."""
    rule = ['---'] + ['---:'] * (len(text_table.columns) - 1)
    lines = [f'| {" | ".join(row)} |' for row in (text_table.columns, rule, *text_table.rows)]
    return '\n'.join([f'## {text_table.title}', '', *lines, ''])


def number(value: float) -> str:
    """Return a time or a ratio with three significant digits."""
    digits = 0 if value >= 100 else 1 if value >= 10 else 2 if value >= 1 else 3
    return f'{value:.{digits}f}'


def share(value: float) -> str:
    """Return a rate in per cent; 100 % only where it is all."""
    return '100 %' if value == 1 else f'{min(100 * value, 99.9):.1f} %'
