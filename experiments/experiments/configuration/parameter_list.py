"""Every parameter that a run can be given, with its unit, range, default and meaning."""

import json
from collections.abc import Sequence
from typing import NamedTuple

from rich.console import Console

from bags.command_line import print_text
from bags.errors import BagError
from experiments.configuration import inputs, node_config
from mpcc_controller.parameters import CarParams
from msgs_yaml import share
from msgs_yaml.strict_yaml import closest
from node_runtime import node_parameters, parameter_docs, parameters
from node_runtime.parameter_docs import GroupDoc, ParameterDoc
from vehicle_plant import parameters as plant_parameters

CAR_FILE, EVERY_NODE = 'car_file', 'NODE'
FIRST = ('controller', 'plant', 'estimator', 'scenario', 'recorder')
HOW = {
    **{role: f'experiments run SCENARIO --set {role}.<name>=<value>' for role in FIRST},
    CAR_FILE: 'in the file that controller.car_file names; identify writes it',
    EVERY_NODE: 'of every node: --set controller.<name>=<value>, plant. ...',
}


class Section(NamedTuple):
    """The parameters of one kind of file, in groups."""

    name: str  # a role of --set, CAR_FILE or EVERY_NODE
    how: str  # to set them
    defaults: str  # where the defaults are, '' without any
    groups: tuple[GroupDoc, ...]


def sections(controller: str = 'mpcc') -> tuple[Section, ...]:
    """Return every parameter; the defaults are those of a controller, by name or file.

    Raises BagError for a controller that does not exist, and ParameterError for one that cannot be
    read.
    """
    listed = []
    for role in FIRST:
        package, name = node_config.DEFAULTS[role]
        path = share.path(package, 'config', name)
        if role == 'controller':
            path = node_config.find_controller(controller).config
        file = parameters.read_file(path, share.path(package, 'config'))
        groups = parameter_docs.describe(inputs.LOADERS[role][0], file)
        if role == 'plant':
            groups = (plant_parameters.EXTRAS, *groups)
        listed.append(Section(role, HOW[role], path.name, groups))
    car = share.path('mpcc_controller', 'config', 'car.yaml')
    groups = parameter_docs.describe(CarParams, parameters.read_file(car))
    listed.append(Section(CAR_FILE, HOW[CAR_FILE], car.name, groups))
    listed.append(Section(EVERY_NODE, HOW[EVERY_NODE], '', node_parameters.describe_common()))
    return tuple(listed)


def search(every: Sequence[Section], words: Sequence[str]) -> tuple[Section, ...]:
    """Return the parameters whose full name, or text, has every word, in any case.

    A parameter that is named in full is returned alone. Raises BagError, with the closest name,
    where there is none.
    """
    names = {full_name(section, row) for section, _, row in _rows(every)}
    is_full = len(words) == 1 and words[0] in names

    def fits(section, group, row):
        name = full_name(section, row)
        text = f'{name} {row.meaning} {group.meaning}'.lower()
        return name == words[0] if is_full else all(word.lower() in text for word in words)

    matches = []
    for section in every:
        chosen = (
            group._replace(parameters=tuple(r for r in group.parameters if fits(section, group, r)))
            for group in section.groups
        )
        if groups := tuple(group for group in chosen if group.parameters):
            matches.append(section._replace(groups=groups))
    if not matches:
        short = {name.rpartition('.')[2]: name for name in sorted(names)}
        near = [closest(words[0], names), closest(words[0], short)]
        raise BagError(f'no parameter has {" and ".join(words)!r}{next(filter(None, near), "")}')
    return tuple(matches)


def full_name(section: Section, row: ParameterDoc) -> str:
    """Return the name as --set takes it, or with the section before it."""
    return f'{section.name}.{row.name}'


def as_json(shown: Sequence[Section]) -> str:
    """Return the parameters as a JSON list of objects."""
    rows = [
        {**row._asdict(), 'name': full_name(section, row), 'group_meaning': group.meaning}
        for section, group, row in _rows(shown)
    ]
    return json.dumps(rows, indent=2)


def show(shown: Sequence[Section], console: Console) -> None:
    """Print two lines per parameter, in groups: name, default and range; meaning."""
    for section in shown:
        defaults = f'; defaults of {section.defaults}' if section.defaults else ''
        print_text(console, f'{section.name}: {section.how}{defaults}', style='bold')
        for group in section.groups:
            name = f'{group.name}: ' if group.name else ''
            print_text(console, f'\n{name}{group.meaning}', style='italic')
            for row in group.parameters:
                unit = '' if row.unit == '-' else f' {row.unit}'
                value = f'{full_name(section, row)} = {row.default_text}'
                print_text(console, f'  {value}  [{row.allowed}{unit}]')
                print_text(console, f'      {row.meaning}')
        console.print()


def _rows(every):
    """Yield section, group and parameter of each."""
    for section in every:
        for group in section.groups:
            for row in group.parameters:
                yield section, group, row
