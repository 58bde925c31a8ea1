"""Start the nodes of an experiment, record them, stop them, and compare what was driven."""

import argparse
from pathlib import Path

from rich.console import Console

HELP = 'drive a scenario, record it, compare what drove'
RUNS = Path('bags', 'runs')
TIME_LIMIT_S = 900.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `experiments run`."""
    parser.add_argument('scenario', metavar='SCENARIO', help='a name, or the path of a YAML file')
    parser.add_argument(
        '--controller',
        action='append',
        metavar='C',
        help='a name in mpcc_controller/config, or a YAML file; may be given several times '
        '(default: mpcc)',
    )
    parser.add_argument(
        '--mode',
        choices=('lockstep', 'realtime'),
        default='lockstep',
        help='lockstep: simulated time, as fast as it goes, repeatable; realtime: wall clock',
    )
    parser.add_argument(
        '--out',
        type=Path,
        default=RUNS,
        metavar='DIR',
        help=f'receives <scenario>/<controller>/ and the comparison (default: {RUNS})',
    )
    parser.add_argument(
        '--set',
        action='append',
        default=[],
        dest='settings',
        metavar='NODE.param=value',
        help='set a parameter of the plant, controller, scenario or recorder',
    )
    parser.add_argument(
        '--markers',
        action='store_true',
        help='also start markers_node, which draws the run for RViz and Foxglove (/markers, /tf)',
    )
    parser.add_argument(
        '--time-limit',
        type=_seconds,
        default=TIME_LIMIT_S,
        metavar='S',
        help=f'wall time after which a run is given up (default: {TIME_LIMIT_S:.0f} s)',
    )


def _seconds(text):
    value = float(text)
    if not 0.0 < value < float('inf'):
        raise argparse.ArgumentTypeError(f'must be positive and finite, is {text}')
    return value


def run(chosen: argparse.Namespace) -> int:
    """Make the runs; 0 when every one completed. Raises BagError."""
    # the cores take a second to load: only who runs waits for them
    from experiments.run import campaign

    return campaign.run_all(
        campaign.Plan(
            chosen.scenario,
            chosen.controller or ['mpcc'],
            chosen.mode,
            chosen.out,
            chosen.settings,
            chosen.time_limit,
            chosen.markers,
        ),
        Console(),
    )
