"""Print the latency of each part of a tick, missed ticks, and the intervals between commands."""

import argparse
from typing import Any

from rich.console import Console
from rich.table import Table

from bags import command_line
from bags.command_line import number_text, print_text

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
add_arguments = command_line.add_summary_arguments


def run(args: argparse.Namespace) -> int:
    """Print the report. Raises BagError when the bag cannot be read."""
    from bags.evaluation.bag_summary import timing_report
    from bags.storage import read

    return command_line.print_summary(timing_report(read.load(args.bag)), args.json, show)


def show(report: dict[str, Any], console: Console) -> None:
    """Print a report (`bag_summary.timing_report`); a dash where its bag lacks a time."""
    from bags.evaluation.bag_summary import QUANTILES, describe_ticks
    from bags.storage.invalid_messages import describe_invalid

    table = Table(box=None, header_style='bold', pad_edge=False)
    table.add_column('ms')
    for name in QUANTILES:
        table.add_column(name, justify='right')
    rows = {title: report['parts_ms'][name] for name, title in TITLES.items()}
    rows['between two commands'] = report['interval_ms']
    rows['state sent after its stamp'] = report['state_sent_after_its_stamp_ms']
    for title, values in rows.items():
        table.add_row(title, *(number_text((values or {}).get(name), '.2f') for name in QUANTILES))
    console.print(table)
    for line in describe_invalid(report):
        print_text(console, line, 'red')
    console.print(describe_ticks(report['ticks']), highlight=False)
    mean = number_text(report['interval_ms']['mean'], '.3f')
    console.print(f'mean interval {mean} ms', highlight=False)
