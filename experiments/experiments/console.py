"""What commands print: tables without lines, on a console that is wide where it is no terminal."""

from collections.abc import Collection, Iterable, Sequence
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table


def wide(width: int) -> Console:
    """Return a console of so many characters in a file or pipe, where nothing is to be folded."""
    console = Console()
    if not console.is_terminal:
        console.width = width
    return console


def table(
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    left: Collection[str] | None = None,
    **column: Any,
) -> Table:
    """Return a table of texts, which may have markup.

    The columns `left`, by default the first, are aligned to the left, the others to the right;
    `column` are further settings of all of them.
    """
    left = columns[:1] if left is None else left
    result = Table(box=None, padding=(0, 2, 0, 0))
    for name in columns:
        result.add_column(escape(name), justify='left' if name in left else 'right', **column)
    for row in rows:
        result.add_row(*row)
    return result
