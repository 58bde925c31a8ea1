"""Tables in Markdown, which the terminal shows as well as a page."""

from collections.abc import Iterable, Sequence


def markdown(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table; its first column is left-aligned, the others right-aligned."""
    rule = ['---'] + ['---:'] * (len(columns) - 1)
    lines = [f'| {" | ".join(map(str, row))} |' for row in (columns, rule, *rows)]
    return '\n'.join([f'## {title}', '', *lines, ''])


def number(value: float) -> str:
    """Return a time or a ratio with three significant digits, a dash for NaN."""
    if value != value:
        return '-'
    digits = 0 if value >= 100 else 1 if value >= 10 else 2 if value >= 1 else 3
    return f'{value:.{digits}f}'


def share(value: float) -> str:
    """Return a rate in per cent; 100 % only where it is all."""
    return '100 %' if value == 1 else f'{min(100 * value, 99.9):.1f} %'
