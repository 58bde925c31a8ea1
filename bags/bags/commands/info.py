"""Print what a bag contains, and latency and deadline misses of the run."""

import argparse
from collections.abc import Iterator, Mapping
from typing import Any

from rich.console import Console
from rich.text import Text

from bags import command_line
from bags.command_line import number_text, print_text

HELP = 'contents of a bag, latency and deadline misses of the run'
MB = 1e6
LONGEST_VALUE = 100  # characters of a note of the run
add_arguments = command_line.add_summary_arguments


def run(args: argparse.Namespace) -> int:
    """Print the summary. Raises BagError when the bag cannot be read."""
    from bags.evaluation.bag_summary import summarize_bag
    from bags.storage import read

    # the damage is part of what is printed
    summary = summarize_bag(read.load(args.bag, warn=False))
    return command_line.print_summary(summary, args.json, show)


def show(summary: Mapping[str, Any], console: Console) -> None:
    """Print a summary (`bag_summary.summarize_bag`) for a person."""
    from bags.storage.invalid_messages import describe_invalid

    size = f'{summary["bytes"] / MB:.2f} MB'
    if len(summary['files']) > 1:
        size += f' in {len(summary["files"])} files'
    console.print(Text(summary['path'], style='bold'), f'{size},', summary['mode'])
    console.print(f'{summary["messages"]} messages in {summary["duration_s"]:.3f} s')
    if summary['damage']:
        console.print(Text(summary['damage'], style='red'))
    columns, rows = ('topic', 'messages', 'rate in Hz', 'longest gap in s', 'lost'), []
    for name, counts in summary['topics'].items():
        lost = number_text(counts['lost'], 'd')
        if counts['lost']:
            lost += f' in {counts["lost_places"]} places'
        messages = Text(str(counts['messages']), style='' if counts['messages'] else 'red')
        rate, gap_s = number_text(counts['rate_hz'], '.2f'), counts['longest_gap_s']
        lost = Text(lost, style='red' if counts['lost'] else '')
        rows.append((name, messages, rate, number_text(gap_s, '.3f'), lost))
    console.print(command_line.table(columns, rows))
    for line in describe_invalid(summary):
        print_text(console, line, 'red')
    for line in _describe_run(summary):
        print_text(console, line)
    for name, value in summary['run'].items():
        text = ' '.join(value.split())
        text = text if len(text) <= LONGEST_VALUE else f'{text[:LONGEST_VALUE]} ...'
        # a hash stays one word, which can be copied
        print_text(console, f'{name}: {text}')


def _describe_run(summary) -> Iterator[str]:
    """Yield latency, ticks and reports of the controller, a line each."""
    from bags.evaluation.bag_summary import describe_ticks

    if summary['latency_ms'] is not None:
        quantiles = (f'{name} {value:.2f}' for name, value in summary['latency_ms'].items())
        yield f'state to command in ms: {", ".join(quantiles)}'
    if summary['ticks'] is not None:
        yield describe_ticks(summary['ticks'])
    if summary['rungs'] is not None:
        rungs = ', '.join(f'{name} {n}' for name, n in summary['rungs'].items())
        count, on_last = summary['reports']['count'], summary['reports']['on_last_state']
        ended = f', {on_last} of them on the last state, which is no tick' if on_last else ''
        yield f'{count} reports of the controller{ended}'
        yield f'rungs: {rungs}'
        for reason, n in summary['fallbacks'].items():
            yield f'  fell back {n} times: {reason}'
