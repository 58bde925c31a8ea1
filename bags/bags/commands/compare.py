"""Compare runs from their bags alone: a table, comparison.json and .csv, figures, report.html."""

import argparse
import os
import sys
from pathlib import Path

from rich.console import Console

from bags import command_line

HELP = 'table, JSON, CSV, figures and interactive report of bags'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bags compare`."""
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG')
    parser.add_argument(
        '--list-metrics', action=_ListMetrics, nargs=0, help='print what each metric means and exit'
    )
    command_line.add_out(parser, 'the folder of the first bag', 'the files')
    parser.add_argument(
        '--force', action='store_true', help='compare runs of different scenarios or plants anyway'
    )
    text = 'figures for a paper, too: the sheet as SVG, and each panel singly as PNG and SVG'
    parser.add_argument('--figures', action='store_true', help=text)
    parser.add_argument(
        '--overlay',
        type=Path,
        action='append',
        default=[],
        metavar='CSV',
        help='draw the curves of this file, too: docs/report.md has its columns (may be repeated)',
    )


class _ListMetrics(argparse.Action):
    def __call__(self, parser, *_):
        from bags.evaluation import metrics

        for metric in metrics.METRICS.values():
            unit = f' [{metric.unit}]' if metric.unit else ''
            print(f'{metric.name}{unit}: {metric.meaning}')
        parser.exit()


def run(args: argparse.Namespace) -> int:
    """Compare and show. Raises BagError."""
    from bags.report.comparison import compare_bags, show_comparison
    from bags.storage.mcap_reader import looks_like_bag

    # as in FOLDER/*
    others = [path for path in args.bags if path.exists() and not looks_like_bag(path)]
    bags = [path for path in args.bags if path not in others] or args.bags
    if len(bags) < len(args.bags):
        print(f'left out, since they are no bags: {", ".join(map(str, others))}', file=sys.stderr)
    out = args.out or Path(os.path.abspath(bags[0])).parent
    compared = compare_bags(bags, out, args.force, args.overlay, singly=args.figures)
    show_comparison(compared, Console())
    return 0
