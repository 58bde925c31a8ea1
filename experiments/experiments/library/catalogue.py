"""What the library has: its families and entries, listed, chosen and written as files."""

import argparse
import inspect
from collections.abc import Sequence

from rich.console import Console

from bags.command_line import print_text
from bags.errors import BagError
from experiments import console as tables
from experiments.drive_row import Row
from experiments.families import draw
from msgs_yaml.strict_yaml import closest
from scenario_publisher import scenario


def show(console: Console) -> int:
    """Print families and entries; return exit code 0."""
    families = {
        name: inspect.getdoc(family).split('.')[0].removeprefix('Return ').split(': ')[0]
        for name, family in draw.LIBRARY.items()
    }
    entries = {name: scenario.load(name).description for name in entries_of_library()}
    for title, members in (('family', families), ('entry', entries)):
        rows = [(name, ' '.join(text.split())) for name, text in members.items()]
        console.print(tables.table((title, ''), rows, left=(title, '')))
    return 0


def entries_of_library() -> list[str]:
    """Return the scenarios that expect something of a run, by name."""
    return [name for name in scenario.available() if scenario.load(name).expect]


def choose(
    families: Sequence[str], with_entries: bool, entries: Sequence[str]
) -> tuple[list[str], list[str]]:
    """Return the families and the entries to be driven.

    Where none is named these are all entries, or all families of emergencies.

    Raises BagError for an unknown one, and for names of the kind that is not driven.
    """
    if with_entries and families:
        raise BagError('--family: --entries drives no family; leave one of both out')
    if entries and not with_entries:
        raise BagError('--entry: goes with --entries')
    if with_entries:
        return [], _known('--entry', entries, entries_of_library())
    return _known('--family', families, list(draw.LIBRARY)) if families else [*draw.FAMILIES], []


def _known(option, chosen, available):
    for name in chosen:
        if name not in available:
            hint = closest(name, available)
            raise BagError(f'{option}: no {name!r}; there are {", ".join(available)}{hint}')
    return list(dict.fromkeys(chosen)) or list(available)


def write_draw(options: argparse.Namespace, console: Console) -> int:
    """Write a draw as a scenario file; return exit code 0. Raises BagError for no such draw.

    `options` are those of `experiments library`.
    """
    which, path = options.draw, options.out
    row = Row(which, '', (), options.seed, options.difficulty)
    if row.draw is None:
        known = ', '.join(draw.LIBRARY)
        raise BagError(f'{which!r} is no draw; allowed FAMILY:INDEX, FAMILY one of {known}')
    scene = draw.draw(*row.draw[:4])
    settings = ' '.join(
        f'--set {role}.{name}={value}'
        for role, values in scene.settings.items()
        for name, value in values.items()
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    how = f'# drive it with: experiments run {path} {settings}\n' if settings else ''
    path.write_text(how + scene.text)
    print_text(console, f'{path}' + (f'; drive it with {settings}' if settings else ''))
    return 0
