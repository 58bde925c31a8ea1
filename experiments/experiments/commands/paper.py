"""Draw both experiments of the paper anew: one distance in two frames, and the double lane change.

The controllers drive through the node graph; everything is computed from their bags.
"""

import argparse
from pathlib import Path

from rich.console import Console

from bags.command_line import add_out, print_paths
from bags.errors import BagError

HELP = 'both experiments of the paper, driven and drawn'
EXAMPLE = 'experiments paper --out /tmp/paper'
OUT = Path('paper')
# run files: a lap of the circle, and the setting that comes nearest to the paper's figures
CIRCLE = Path('paper', 'circle_20m', 'drive.yaml')
PICTURE = Path('paper', 'picture', 'drive.yaml')  # docs/howto/paper_picture.md
TIME_LIMIT_S = 600.0  # of wall time for a drive


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments paper`."""
    add_out(parser, OUT, 'all files')


def run(options: argparse.Namespace) -> int:
    """Drive, compare and draw. Raises BagError."""
    from bags.figures import frame_distances
    from bags.report.comparison import compare_bags, show_comparison
    from bags.run import load

    console = Console()
    (bag,) = _drive(CIRCLE, options.out, console)
    folder = options.out / CIRCLE.parent.name
    _, distances = frame_distances.write_frame_distances(load(bag).drive, folder)
    driven = _drive(PICTURE, options.out, console)
    comparison = compare_bags(driven, options.out / 'double_lane_change', singly=True)
    show_comparison(comparison, console)
    print_paths(console, {'distances': distances['figure']})
    return 0


def _drive(file, out, console):
    """Return the bags of the runs of a file; BagError when one of them was not completed."""
    from experiments.run import run_and_compare

    if not file.is_file():
        raise BagError(f'{file}: is not here; `experiments paper` runs in a clone')
    request = run_and_compare.Request(
        str(file), (), 'lockstep', out / 'bags', (), TIME_LIMIT_S, overwrite=True
    )
    _, outcomes = run_and_compare.run_controllers(request, console)
    for outcome in outcomes:
        if not outcome.completed:
            raise BagError(f'{outcome.controller}: {outcome.message}')
    return [outcome.bag for outcome in outcomes]
