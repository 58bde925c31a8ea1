"""Where the time of each tick went, which ticks were missed, and how steady the commands came."""

import argparse
import json
from collections.abc import Iterator
from typing import Any

from rich.console import Console
from rich.table import Table

HELP = 'where the time of each tick went, and which ticks were missed'
TITLES = {
    'total': 'state sent to command sent',
    'transport': '  transport',
    'wait': '  wait for other inputs',
    'prepare': '  prepare',
    'solve': '  solve',
    'publish': '  publish',
    'rest': '  rest',
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bags timing`."""
    parser.add_argument('bag', metavar='BAG', help='folder of a bag, or its MCAP file')
    parser.add_argument('--json', action='store_true', help='print everything as one JSON object')


def run(chosen: argparse.Namespace) -> int:
    """Print the report. Raises BagError when the bag cannot be read."""
    from bags.evaluation import tick_timing
    from bags.storage import read

    found = tick_timing.timing_report(read.load(chosen.bag))
    if chosen.json:
        print(json.dumps(found, indent=2))
    else:
        show(found, Console())
    return 0


def show(found: dict[str, Any], console: Console) -> None:
    """Print a report for a person; a dash for what its bag does not tell."""
    from bags.evaluation.tick_timing import QUANTILES
    from bags.storage import info
    from bags.storage.invalid_messages import describe_invalid

    table = Table(box=None, header_style='bold', pad_edge=False)
    table.add_column('ms')
    for name in QUANTILES:
        table.add_column(name, justify='right')
    for title, values in _rows(found):
        table.add_row(title, *(_number((values or {}).get(name), 2) for name in QUANTILES))
    console.print(table)
    for line in describe_invalid(found):
        console.print(line, style='red', markup=False, highlight=False, soft_wrap=True)
    console.print(info.told(found['ticks']), highlight=False)
    console.print(f'mean interval {_number(found["interval_ms"]["mean"], 3)} ms', highlight=False)


def _number(value, decimals):
    return '-' if value is None else f'{value:.{decimals}f}'


def _rows(found) -> Iterator[tuple[str, dict[str, float] | None]]:
    """Yield each line's title and quantiles."""
    for name, title in TITLES.items():
        yield title, found['parts_ms'][name]
    yield 'between two commands', found['interval_ms']
    yield 'state sent after its stamp', found['state_sent_after_its_stamp_ms']
