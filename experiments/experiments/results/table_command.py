"""`experiments table`: a summary or a comparison, on the console and as files."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import pandas
from rich.console import Console
from rich.table import Table

from bags.command_line import print_text
from experiments.results import drive_table, marginals
from experiments.results.drive_table import CONTROLLER


class Request(NamedTuple):
    """The arguments of `experiments table`."""

    table: Path
    metric: str
    by: Sequence[str]  # columns
    pair: tuple[str, str] | None  # controllers
    bins: int
    csv: Path | None
    markdown: Path | None


def show(request: Request, console: Console) -> int:
    """Print the table and write its files; return exit code 0. Raises BagError."""
    table = drive_table.load(request.table)
    if request.pair:
        by = request.by
        result = marginals.compare(table, request.metric, request.pair, by, request.bins)
    else:
        by = request.by or [name for name in (CONTROLLER,) if name in table.rows]
        result = marginals.summarise(table, request.metric, by, request.bins)
    texts = [[_text(value) for value in row] for row in result.itertuples(index=False)]
    shown = Table(box=None, padding=(0, 2, 0, 0))
    for name in result:
        shown.add_column(name, justify='left' if name in by else 'right')
    for row in texts:
        shown.add_row(*row)
    minus = f' of {request.pair[0]} minus {request.pair[1]}' if request.pair else ''
    print_text(console, f'{request.metric}{minus}')
    console.print(shown)
    if table.failed:
        print_text(console, f'{table.failed:,} drives without a result are left out')
    if not request.pair and marginals.repeats(table) and 'share' in result:
        print_text(console, 'some drives are repeats of others: the true intervals are wider')
    for path, write in ((request.csv, _csv), (request.markdown, _markdown)):
        if path:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(write(result, texts))
            print_text(console, str(path))
    return 0


def _csv(result, _):
    return result.map(
        lambda value: marginals.level_text(value) if isinstance(value, pandas.Interval) else value
    ).to_csv(index=False)


def _markdown(result, texts):
    lines = [list(result), ['---'] * len(result.columns), *texts]
    return ''.join(f'| {" | ".join(line)} |\n' for line in lines)


def _text(value):
    if value is None or value != value:
        return '–'
    return marginals.level_text(value) if not isinstance(value, int) else f'{value}'
