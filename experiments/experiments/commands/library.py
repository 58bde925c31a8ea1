"""Drive controllers through families of emergencies, and say which cars survived.

A family is a kind of emergency (`--list`); draw INDEX of it under SEED is always the same scenario.
Survived: the outline touched nothing, no wheel was over 0.5 m off the road, the sideslip angle
stayed below 30 deg above 5 m/s, and the car finished or stands. Prints the share per family and
controller with Wilson's interval of 95 %, and the cause of every loss.

The table is DIR/results.parquet, one row per drive. Finished drives are kept in DIR/drives.jsonl:
the same command continues what was interrupted, and drives only what is missing.

exit code: 0 when every drive has a result, every expectation of the entries is met, and every
family reaches --at-least; 1 otherwise, and for unusable input; 130 after Ctrl-C.
"""

import argparse
from pathlib import Path

from rich.console import Console

from bags.errors import BagError
from experiments.commands import (
    add_list,
    add_sensors,
    add_time_limit,
    add_workers,
    count,
    positive_count,
    share,
)

HELP = 'drive families of emergencies; who survived, with intervals and causes'
EXAMPLE = (
    'experiments library --family pop_up --draws 20 --controller mpcc --controller mpcc_road '
    '--out /tmp/library'
)
EXIT_CODES = {
    1: 'a drive has no result, an expectation of an entry is not met, or a family survives '
    'less than --at-least'
}
LIMIT_S = 300.0
DIFFICULTIES = ('nominal', 'hard')
DRAWN = {'draws': 100, 'first': 0, 'seed': 1000, 'difficulty': DIFFICULTIES[0]}  # unless told


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments library`."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    what = parser.add_mutually_exclusive_group()
    what.add_argument('--list', action='store_true', help='print the families and the entries')
    text = 'write one draw as a scenario file to --out FILE'
    what.add_argument('--draw', metavar='FAMILY:INDEX', help=text)
    text = 'drive the scenarios with `expect:` in their file, and check what they expect'
    what.add_argument('--entries', action='store_true', help=text)
    add_list(parser, '--family', 'a family', 'all of them', metavar='F')
    add_list(parser, '--entry', 'with --entries: one of them', 'all of them', metavar='E')
    parser.set_defaults(**DRAWN)
    text = 'draws per family (default: %(default)s)'
    parser.add_argument('--draws', type=positive_count, metavar='N', help=text)
    text = 'the first draw (default: %(default)s)'
    parser.add_argument('--first', type=count, metavar='INDEX', help=text)
    text = 'of the draws; tune below 1000, judge from 1000 on (default: %(default)s)'
    parser.add_argument('--seed', type=count, metavar='S', help=text)
    parser.add_argument('--difficulty', choices=DIFFICULTIES, help='(default: %(default)s)')
    text = 'a name in mpcc_controller/config, or a YAML file'
    add_list(parser, '--controller', text, 'mpcc_road', metavar='C')
    text = 'set a parameter of plant or controller'
    add_list(parser, '--set', text, dest='settings', metavar='NODE.param=value')
    add_sensors(parser)
    parser.add_argument('--out', type=Path, metavar='PATH', help='receives table and records')
    add_workers(parser, 'the table')
    add_time_limit(parser, '--limit-s', LIMIT_S, 'a drive counts as failed')
    text = 'exit code 1 when a family survives less, 0 to 1'
    parser.add_argument('--at-least', type=share, metavar='SHARE', help=text)


def run(options: argparse.Namespace) -> int:
    """Run what is asked; 0 when all is well. Raises BagError."""
    from experiments import library

    console = Console()
    if options.list:
        return library.show_catalogue(console)
    if options.out is None:
        raise BagError('--out is missing: the folder, or the file of --draw, that is written')
    if options.draw:
        return library.write_draw(options, console)
    for name in DRAWN if options.entries else ():
        if getattr(options, name) != DRAWN[name]:
            raise BagError(f'--{name}: has no effect with --entries; leave one of both out')
    families, entries = library.choose(options.family, options.entries, options.entry)
    return library.run(options, families, entries, console)
