"""Rebuild summary, footer and metadata.yaml of bags that were cut short."""

import argparse
import sys

from bags.errors import BagError

HELP = 'rebuild summary, footer and metadata.yaml after a kill'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bags repair`."""
    parser.add_argument('bag', nargs='+', metavar='BAG', help='folder of a bag, or its MCAP file')


def run(chosen: argparse.Namespace) -> int:
    """Repair every bag that was named; 1 when one of them could not be."""
    from bags.storage import repair

    failed = 0
    for bag in chosen.bag:
        try:
            print(repair.describe_repair(repair.repair_bag(bag)))
        except BagError as error:
            failed = 1
            print(f'error: {error}', file=sys.stderr)
    return failed
