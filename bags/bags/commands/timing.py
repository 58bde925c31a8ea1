"""Print the latency of each part of a tick, missed ticks, and the intervals between commands."""

import argparse
import json
from collections.abc import Iterator
from typing import Any

from rich.console import Console
from rich.table import Table

HELP = 'latency of each part of a tick, and missed ticks'
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


def run(args: argparse.Namespace) -> int:
    """Print the report. Raises BagError when the bag cannot be read."""
    from bags.evaluation.tick_timing import timing_report
    from bags.storage import read

    report = timing_report(read.load(args.bag))
    if args.json:
        print(json.dumps(report, indent=2))
    else:
        show(report, Console())
    return 0


def show(report: dict[str, Any], console: Console) -> None:
    """Print a report (`tick_timing.timing_report`); a dash where its bag lacks a time."""
    from bags.evaluation.tick_timing import QUANTILES, describe_ticks
    from bags.storage.invalid_messages import describe_invalid

    table = Table(box=None, header_style='bold', pad_edge=False)
    table.add_column('ms')
    for name in QUANTILES:
        table.add_column(name, justify='right')
    for title, values in _rows(report):
        table.add_row(title, *(_number((values or {}).get(name), 2) for name in QUANTILES))
    console.print(table)
    for line in describe_invalid(report):
        console.print(line, style='red', markup=False, highlight=False, soft_wrap=True)
    console.print(describe_ticks(report['ticks']), highlight=False)
    console.print(f'mean interval {_number(report["interval_ms"]["mean"], 3)} ms', highlight=False)


def _number(value, decimals):
    return '-' if value is None else f'{value:.{decimals}f}'


def _rows(report) -> Iterator[tuple[str, dict[str, float] | None]]:
    """Yield each line's title and quantiles."""
    for name, title in TITLES.items():
        yield title, report['parts_ms'][name]
    yield 'between two commands', report['interval_ms']
    yield 'state sent after its stamp', report['state_sent_after_its_stamp_ms']
