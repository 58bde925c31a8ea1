"""What a bag holds, and how the run behind it went in time."""

import argparse
import json
import warnings

from rich.console import Console

from bags.errors import DamagedBagWarning

HELP = 'contents of a bag, and how the run behind it went in time'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bags info`."""
    parser.add_argument('bag', metavar='BAG', help='folder of a bag, or its MCAP file')
    parser.add_argument('--json', action='store_true', help='print everything as one JSON object')


def run(chosen: argparse.Namespace) -> int:
    """Print the summary. Raises BagError when the bag cannot be read."""
    from bags.evaluation.bag_summary import summarize_bag
    from bags.storage import info, read

    with warnings.catch_warnings():
        # the damage is part of what is printed
        warnings.simplefilter('ignore', DamagedBagWarning)
        found = summarize_bag(read.load(chosen.bag))
    if chosen.json:
        print(json.dumps(found, indent=2))
    else:
        info.show(found, Console())
    return 0
