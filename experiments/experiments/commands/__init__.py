"""The subcommands of `experiments`, one module each, with HELP, EXAMPLE, add_arguments and run.

Modules import what they need in `run`: simulation, controllers, pandas and matplotlib take a second
each to load, and `experiments --help` is to answer at once.
"""

import argparse
import os
import sys
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Any

GRADES = ('consumer', 'automotive', 'survey')  # of sensors
SENSORS = 'plant.sensors'


def number(kind: type, allowed: str, low: float = -inf, high: float = inf) -> Callable[[str], Any]:
    """Return the type of an argument: a number of a kind from `low` to `high`.

    `allowed` describes these in argparse's error.
    """

    def parse(text):
        value = kind(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f'must be {allowed}, is {text}')
        return value

    parse.__name__ = kind.__name__  # in the error about text that is no number
    return parse


positive_count = number(int, 'a positive number', 1)
count = number(int, '0 or more', 0)
positive_number = number(float, 'positive and finite', sys.float_info.min, sys.float_info.max)
share = number(float, 'from 0 to 1', 0.0, 1.0)


def add_jobs(parser: argparse.ArgumentParser, constant: str) -> None:
    """Add the option --jobs; `constant` is what it does not change."""
    text = f'processes (default: one per usable core); does not change {constant}'
    cores = len(os.sched_getaffinity(0))
    parser.add_argument('--jobs', type=positive_count, default=cores, metavar='N', help=text)


def add_workers(parser: argparse.ArgumentParser, constant: str) -> None:
    """Add the options --jobs and --dask of `row_runner.driving`; `constant` as in `add_jobs`."""
    add_jobs(parser, constant)
    text = 'of a dask scheduler, as tcp://10.0.0.1:8786, whose workers do the drives; instead of '
    text += '--jobs (docs/batch.md)'
    parser.add_argument('--dask', default='', metavar='ADDRESS', help=text)


def add_table(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a command that reads a table of drives."""
    parser.add_argument('table', type=Path, metavar='DIR', help='of the table, or its Parquet file')
    text = 'a column of the table (default: survived)'
    parser.add_argument('--metric', default='survived', metavar='NAME', help=text)
    text = 'intervals for a column of many numbers (default: 5)'
    parser.add_argument('--bins', type=positive_count, default=5, metavar='N', help=text)


def add_time_limit(
    parser: argparse.ArgumentParser, option: str, default_s: float, then: str
) -> None:
    """Add the option of a limit of wall time [s]; `then` is what happens after it."""
    text = f'wall time after which {then} (default: {default_s:g} s)'
    look = {'dest': 'time_limit_s', 'metavar': 'S', 'help': text}
    parser.add_argument(option, type=positive_number, default=default_s, **look)


class _Sensors(argparse.Action):
    """Adds the setting of the plant that a grade stands for."""

    def __call__(self, parser, namespace, values, option_string=None):
        namespace.settings = [*namespace.settings, f'{SENSORS}={sensors_file(values)}']


def sensors_file(grade: str) -> str:
    """Return the file of a grade in vehicle_plant/config; a path stays as it is."""
    return f'sensors_{grade}.yaml' if grade in GRADES else grade


def add_sensors(parser: argparse.ArgumentParser) -> None:
    """Add the option --sensors, which adds to the list `settings`."""
    parser.add_argument(
        '--sensors',
        action=_Sensors,
        default=argparse.SUPPRESS,
        metavar='GRADE',
        help=f'the car measures: {", ".join(GRADES)}, or a file as those in vehicle_plant/config; '
        'the same as --set plant.sensors=FILE (default: no sensors). The controller then gets the '
        'estimate in place of the true state',
    )


def add_list(
    parser: argparse.ArgumentParser, option: str, text: str, default: str = '', **settings: Any
) -> None:
    """Add an option that may be given several times; `default` describes what an empty list is."""
    text += '; may be given several times' + (f' (default: {default})' if default else '')
    parser.add_argument(option, action='append', default=[], help=text, **settings)
