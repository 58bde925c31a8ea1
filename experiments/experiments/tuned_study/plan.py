"""The plan of a study, `study.yaml`: every key is checked before anything is driven or decided.

paper/study/study.yaml says what the keys mean.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

from bags.errors import BagError
from experiments.configuration import node_config, set_option
from experiments.tuned_study.analysis import FACTORS
from experiments.tuned_study.arms import COMPARED, HEADING
from mpcc_controller.parameters import ControllerParams
from msgs_yaml import strict_yaml
from msgs_yaml.strict_yaml import Item, Range, Struct, closest, parse_value
from node_runtime import parameters

FILE = 'study.yaml'
MOST = 1_000_000
PARAMETERS = parameters.leaves(ControllerParams)
Count = Annotated[int, Range(0, MOST, '-')]
Number = Annotated[int, Range(1, MOST, '-')]
Several = Annotated[int, Range(2, MOST, '-')]
Seed = Annotated[int, Range(0, 2**32 - 1 - MOST, '-')]
Share = Annotated[float, Range(0.0, 1.0, '-')]
Positive = Annotated[float, Range(1e-9, 1e9, '-')]
Value = Annotated[float, Range(-1e9, 1e9, '-')]


class Settings:
    """Parameters of a controller, by dotted name."""

    @classmethod
    def from_item(cls, item: Item) -> dict[str, Any]:
        """Return the values of a mapping. Raises YamlError."""
        values = {name: set_option.file_value(member) for name, member in item.items().items()}
        for name, member in item.items().items():
            _check_parameter(member, name, values[name])
        return values


class Ranges:
    """Least and greatest value of parameters of a controller, by dotted name."""

    @classmethod
    def from_item(cls, item: Item) -> dict[str, tuple[float, float]]:
        """Return the ends of every range. Raises YamlError."""
        ranges = {}
        for name, member in item.items().items():
            low, high = ranges[name] = parse_value(tuple[Positive, Positive], member)
            if not low < high:
                raise member.error(f'is from {low:g} to {high:g}; allowed low < high')
            for end in ranges[name]:
                _check_parameter(member, name, end)
        return ranges


class Arm(Struct):
    """A controller that is judged: its weights are searched, or those of a searched arm."""

    controller: str
    settings: Settings = ()


class Tuned(Arm):
    """An arm whose weights are searched, `without` those that its controller has not."""

    without: tuple[str, ...] = ()


class Derived(Arm):
    """An arm with the weights of a tuned one, or those of its controller file."""

    weights: str | None = None
    tasks: Number | None = None  # of the judged ones


COST = ('failure', 'missing_m', 'speed_error_mps', 'sideslip_deg')
# of the picture: least, most, scale
ITEMS = (
    *('baseline_avoids', 'baseline_kept_m', 'mpcc_sideslip_deg', 'baseline_sideslip_deg'),
    *('onset_lead_m', 'speed_gain_mps'),
)
FIRST = {'points': Several, 'tasks': Number}
PLAN = {
    'schema': Literal[1],
    'seeds': {'training': Seed, 'judged': Seed, 'picture': Seed},
    'judged_tasks': Number,
    'starts': {'tasks': Count, 'count': Count, 'speed_kph': Annotated[float, Range(0, 99, 'km/h')]},
    'factorial_tasks': Count,
    'tuned': dict[str, Tuned],
    'derived': dict[str, Derived],
    'factors': dict[str, Settings],
    'search': {
        'ranges': Ranges,
        'first': FIRST,
        'rounds': {**FIRST, 'count': Count},
        'cost': dict.fromkeys(COST, Positive),
    },
    'confirmatory': {
        'avoidance_gap': {'margin': Share},
        'sideslip_balance': {'margin': Share, 'better_by_deg': Positive},
    },
    'balance': {'kept_m': Positive, 'min_speed_mps': Positive, 'brake_onset_m': Positive},
    'stop': {'from': Several, 'widths': tuple[Share, Share], 'cap': Several},
    'picture': {
        'drives': Number,
        'batch': Number,
        'nearest': Number,
        'cap': Positive,
        'items': dict.fromkeys(ITEMS, tuple[Value, Value, Positive]),
    },
}


def read(folder: Path) -> dict[str, Any]:
    """Return the plan of a study as it is written in its folder.

    Raises BagError that names file, line, key and what is allowed.
    """
    file = folder / FILE
    if not file.is_file():
        raise BagError(f'{file}: is no file; it has the plan of the study')
    root = strict_yaml.read(file)
    _check_arms(root, parse_value(PLAN, root))
    return root.value()


def _check_parameter(item, name, value):
    """Raise YamlError for a value that no controller takes."""
    if name not in PARAMETERS:
        raise item.error(f'is no parameter of a controller{closest(name, PARAMETERS)}')
    if fault := PARAMETERS[name].fault(value):
        raise item.error(fault)


def _check_arms(root, plan):
    """Raise YamlError for names of arms, controllers and parameters that are nowhere else."""
    tuned, ranges = plan['tuned'], plan['search']['ranges']

    def check(key, name, known):
        if name not in known:
            hint = closest(name, known)
            raise root.error_at(key, f'there is no {name!r}{hint}; allowed {", ".join(known)}')

    for arm in COMPARED:
        if arm not in tuned:
            raise root.error_at('tuned', f'key {arm!r} is missing; the verdicts are about it')
    for arm, own in tuned.items():
        for name in own.without:
            check(f'tuned.{arm}.without', name, ranges)
    # the factorial has the heading tolerance of the baseline
    if HEADING not in {*ranges} - {*tuned['frenet'].without}:
        raise root.error_at('tuned.frenet', f'must have {HEADING} in search.ranges')
    for arm, own in plan['derived'].items():
        if arm in tuned:
            raise root.error_at(f'derived.{arm}', 'is in tuned, too; allowed in one of both')
        if own.weights is not None:
            check(f'derived.{arm}.weights', own.weights, tuned)
    for name in plan['factors']:
        check(f'factors.{name}', name, FACTORS)
    for key in ('tuned', 'derived'):
        for arm, own in plan[key].items():
            try:
                node_config.find_controller(own.controller)
            except BagError as error:
                raise root.error_at(f'{key}.{arm}.controller', str(error)) from None
