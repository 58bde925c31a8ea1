"""The subcommands of `experiments`, one module each, with HELP, EXAMPLE, add_arguments and run.

Modules import what they need in `run`, so that `experiments --help` answers at once.
"""

import argparse
import os
from pathlib import Path
from typing import Any


def positive_count(text: str) -> int:
    """Return the whole number in an argument; argparse's error unless it is positive."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f'must be a positive number, is {text}')
    return value


def count(text: str) -> int:
    """Return the whole number in an argument; argparse's error unless it is 0 or more."""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f'must be 0 or more, is {text}')
    return value


def positive_number(text: str) -> float:
    """Return the value of an option that must be positive and finite."""
    value = float(text)
    if not 0.0 < value < float('inf'):
        raise argparse.ArgumentTypeError(f'must be positive and finite, is {text}')
    return value


def add_jobs(parser: argparse.ArgumentParser, constant: str) -> None:
    """Add the option --jobs; `constant` is what it does not change."""
    parser.add_argument(
        '--jobs',
        type=positive_count,
        default=len(os.sched_getaffinity(0)),
        metavar='N',
        help=f'processes (default: one per usable core); does not change {constant}',
    )


def add_dask(parser: argparse.ArgumentParser) -> None:
    """Add the option --dask."""
    parser.add_argument(
        '--dask',
        default='',
        metavar='ADDRESS',
        help='of a dask scheduler, as tcp://10.0.0.1:8786, whose workers do the drives; '
        'instead of --jobs (docs/batch.md)',
    )


def add_table(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a command that reads a table of drives."""
    parser.add_argument('table', type=Path, metavar='DIR', help='of the table, or its Parquet file')
    parser.add_argument(
        '--metric',
        default='survived',
        metavar='NAME',
        help='a column of the table (default: survived)',
    )
    parser.add_argument(
        '--bins',
        type=positive_count,
        default=5,
        metavar='N',
        help='intervals for a column of many numbers (default: 5)',
    )


def add_time_limit(
    parser: argparse.ArgumentParser, option: str, default_s: float, then: str
) -> None:
    """Add the option of a limit of wall time [s]; `then` is what happens after it."""
    parser.add_argument(
        option,
        type=positive_number,
        default=default_s,
        metavar='S',
        help=f'wall time after which {then} (default: {default_s:g} s)',
    )


def add_list(
    parser: argparse.ArgumentParser, option: str, text: str, default: str = '', **settings: Any
) -> None:
    """Add an option that may be given several times; `default` describes what an empty list is."""
    text += '; may be given several times' + (f' (default: {default})' if default else '')
    parser.add_argument(option, action='append', default=[], help=text, **settings)
