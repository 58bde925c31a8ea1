"""The paper's first experiment: the distance to the obstacle on a circle, in two frames."""

import argparse
import os
from pathlib import Path

from rich.console import Console

HELP = 'distance to the obstacle on a circle, in two frames (experiment 1)'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bags distances`."""
    parser.add_argument('bag', type=Path, metavar='BAG', help='a run of circle_20m')
    parser.add_argument(
        '--out',
        type=Path,
        metavar='DIR',
        help='receives distances.json, .png and .svg (default: the folder of the bag)',
    )


def run(args: argparse.Namespace) -> int:
    """Compute the distances and show them. Raises BagError."""
    from bags.figures import frame_distance_figure

    out = args.out or Path(os.path.abspath(args.bag)).parent
    frame_distance_figure.show_frame_distances(
        frame_distance_figure.write_from_bag(args.bag, out), Console()
    )
    return 0
