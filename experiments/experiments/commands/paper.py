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
CIRCLE, CIRCLE_CONTROLLER = 'circle_20m', 'mpcc_no_ca'
# the setting that comes nearest to the paper's figures: docs/howto/paper_picture.md
PICTURE = Path('paper', 'picture', 'drive.yaml')
TIME_LIMIT_S = 600.0  # of wall time for a drive


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments paper`."""
    add_out(parser, OUT, 'all files')


def run(options: argparse.Namespace) -> int:
    """Drive, compare and draw. Raises BagError."""
    # imported late: controllers and figures take a second to load
    from bags.figures import frame_distances
    from bags.report.comparison import compare_bags, show_comparison
    from bags.run import load
    from experiments.run import run_file

    if not PICTURE.is_file():
        raise BagError(f'{PICTURE}: is not here; `experiments paper` runs in a clone')
    console = Console()
    (bag,) = _drive(CIRCLE, [CIRCLE_CONTROLLER], options.out, (), console)
    distances = frame_distances.write_frame_distances(load(bag).drive, options.out / CIRCLE)
    picture = run_file.load(str(PICTURE))
    settings = [
        f'{role}.{name}={value}'
        for role, values in picture.settings.items()
        for name, value in values.items()
    ]
    driven = _drive(picture.scenario, picture.controllers, options.out, settings, console)
    comparison = compare_bags(driven, options.out / 'double_lane_change')
    show_comparison(comparison, console)
    print_paths(console, {'distances': distances.figures[0]})
    return 0


def _drive(scenario, controllers, out, settings, console):
    """Return the bags of the runs; BagError when one of them was not completed."""
    from experiments.run import run_and_compare

    request = run_and_compare.Request(
        scenario, controllers, 'lockstep', out / 'bags', settings, TIME_LIMIT_S, overwrite=True
    )
    _, outcomes = run_and_compare.run_controllers(request, console)
    for outcome in outcomes:
        if not outcome.completed:
            raise BagError(f'{outcome.controller}: {outcome.message}')
    return [outcome.bag for outcome in outcomes]
