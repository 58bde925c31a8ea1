"""Print the latency of each part of a tick, missed ticks, and the intervals between commands."""

import argparse
from typing import Any

from rich.console import Console

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

    parts = {title: report['parts_ms'][name] for name, title in TITLES.items()}
    parts['between two commands'] = report['interval_ms']
    parts['state sent after its stamp'] = report['state_sent_after_its_stamp_ms']
    rows = [
        (title, *(number_text((values or {}).get(name), '.2f') for name in QUANTILES))
        for title, values in parts.items()
    ]
    console.print(command_line.table(['ms', *QUANTILES], rows))
    for line in describe_invalid(report):
        print_text(console, line, 'red')
    console.print(describe_ticks(report['ticks']), highlight=False)
    mean = number_text(report['interval_ms']['mean'], '.3f')
    console.print(f'mean interval {mean} ms', highlight=False)
