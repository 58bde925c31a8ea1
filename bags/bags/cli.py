"""The command `bags`: run experiments, compare and look after their recordings."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from bags import info, repair
from bags.errors import BagError
from msgs_yaml.parameters import ParameterError

RUNS = Path('bags', 'runs')
TIME_LIMIT_S = 900.0
INTERRUPTED = 130  # what shells report for SIGINT


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand; return its exit code. Errors are one line on stderr."""
    chosen = _parser().parse_args(arguments)
    try:
        return chosen.command(chosen)
    except (BagError, ParameterError, OSError) as error:
        print(f'error: {" ".join(str(error).split())}', file=sys.stderr)
        return 1
    except KeyboardInterrupt as interrupt:
        print(': '.join(('interrupted', *map(str, interrupt.args))), file=sys.stderr)
        return INTERRUPTED


def _parser():
    parser = argparse.ArgumentParser(prog='bags', description=__doc__)
    commands = parser.add_subparsers(title='commands', required=True, metavar='COMMAND')
    _add_run(commands)
    _add_compare(commands)
    _add_distances(commands)
    for module, meaning in (
        (info, 'contents of a bag, and how the run behind it went in time'),
        (repair, 'rebuild summary, footer and metadata.yaml after a kill'),
    ):
        name = module.__name__.rpartition('.')[2]
        command = commands.add_parser(name, help=meaning)
        command.set_defaults(command=module.run)
        module.add_arguments(command)
    return parser


def _add_run(commands):
    run = commands.add_parser('run', help='drive a scenario, record it, compare what drove')
    run.set_defaults(command=_run)
    run.add_argument('scenario', metavar='SCENARIO', help='a name, or the path of a YAML file')
    run.add_argument(
        '--controller',
        action='append',
        metavar='C',
        help='a name in mpcc_controller/config, or a YAML file; may be given several times '
        '(default: mpcc)',
    )
    run.add_argument(
        '--mode',
        choices=('lockstep', 'realtime'),
        default='lockstep',
        help='lockstep: simulated time, as fast as it goes, repeatable; realtime: wall clock',
    )
    run.add_argument(
        '--out',
        type=Path,
        default=RUNS,
        metavar='DIR',
        help=f'receives <scenario>/<controller>/ and the comparison (default: {RUNS})',
    )
    run.add_argument(
        '--set',
        action='append',
        default=[],
        dest='settings',
        metavar='NODE.param=value',
        help='set a parameter of the plant, controller, scenario or recorder',
    )
    run.add_argument(
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


def _add_compare(commands):
    compare = commands.add_parser('compare', help='table, comparison.json and figures of bags')
    compare.set_defaults(command=_compare)
    compare.add_argument('bags', nargs='+', type=Path, metavar='BAG')
    compare.add_argument(
        '--out',
        type=Path,
        metavar='DIR',
        help='receives comparison.json and figures/ (default: the folder of the first bag)',
    )
    compare.add_argument(
        '--force', action='store_true', help='compare runs of unlike scenarios all the same'
    )


def _add_distances(commands):
    distances = commands.add_parser(
        'distances', help='distance to the obstacle on a circle, in two frames (experiment 1)'
    )
    distances.set_defaults(command=_distances)
    distances.add_argument('bag', type=Path, metavar='BAG', help='a run of circle_20m')
    distances.add_argument(
        '--out',
        type=Path,
        metavar='DIR',
        help='receives distances.json, .png and .svg (default: the folder of the bag)',
    )


def _run(chosen) -> int:
    # the cores that closed_loop stands on take a second to load: only who runs waits for them
    from bags import campaign

    return campaign.run_all(
        campaign.Plan(
            chosen.scenario,
            chosen.controller or ['mpcc'],
            chosen.mode,
            chosen.out,
            chosen.settings,
            chosen.time_limit,
        ),
        Console(),
    )


def _compare(chosen) -> int:
    from bags import compare

    out = chosen.out or Path(os.path.abspath(chosen.bags[0])).parent
    compare.show(compare.bags(chosen.bags, out, chosen.force), Console())
    return 0


def _distances(chosen) -> int:
    from bags import distances

    out = chosen.out or Path(os.path.abspath(chosen.bag)).parent
    distances.show(distances.bag(chosen.bag, out), Console())
    return 0


if __name__ == '__main__':
    sys.exit(main())
