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
PICTURE = Path('paper', 'picture')
SCENARIO = PICTURE / 'double_lane_change_limit.yaml'
CONTROLLERS = tuple(PICTURE / f'{name}_limit.yaml' for name in ('mpcc', 'mpcc_no_ca', 'frenet'))
SETTINGS = (
    'controller.model.friction=0.921',
    'plant.car.scaling.rear.LKY=1.9008',
    'plant.car.suspension.front.antiroll_npm=21900.0',
    'plant.car.suspension.rear.antiroll_npm=18900.0',
)
TIME_LIMIT_S = 600.0  # of wall time for a drive


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments paper`."""
    add_out(parser, OUT, 'all files')


def run(options: argparse.Namespace) -> int:
    """Drive, compare and draw. Raises BagError."""
    # imported late: controllers and figures take a second to load
    from bags.figures import frame_distance_figure
    from bags.report.comparison import compare_bags, show_comparison
    from bags.run import load

    if not SCENARIO.is_file():
        raise BagError(f'{SCENARIO}: is not here; `experiments paper` runs in a clone')
    console = Console()
    (bag,) = _drive(CIRCLE, [CIRCLE_CONTROLLER], options.out, (), console)
    distances = frame_distance_figure.write_frame_distances(load(bag).drive, options.out / CIRCLE)
    driven = _drive(str(SCENARIO), list(map(str, CONTROLLERS)), options.out, SETTINGS, console)
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
