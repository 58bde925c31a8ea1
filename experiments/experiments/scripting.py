"""Drives from Python: `drive` for one, `drive_many` for a sweep; in process, without ROS.

    from experiments import drive, drive_many

    result = drive('double_lane_change', 'mpcc', {'controller.tolerances.contouring_m': 0.4})
    result.metrics['min_v2o_m']
    result.frame('/vehicle/odometry')
    result.signals
    result.figure()

    sweep = drive_many(
        'double_lane_change', ['mpcc', 'frenet'], {'scenario.speed_mps': [18, 20, 22]}
    )
    sweep.frame().plot.scatter('scenario.speed_mps', 'min_v2o_m')

Results are `bags.Run` and `bags.RunSet`, as of recordings. The same arguments give the same run,
except for computing times.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from typing import Any, get_args

import numpy as np
import yaml

from bags.errors import BagError
from bags.run import Run
from bags.run_set import RunSet
from bags.storage.columns import Columns
from experiments import simulation
from experiments.batch.drive_plan import CHANGES, PLANT_FILE
from experiments.batch.study_file import SCENARIO_SETTINGS
from experiments.configuration import inputs, set_option
from experiments.simulation import Setup
from experiments.worker_pool import WorkerPool
from msgs_yaml import share
from msgs_yaml.strict_yaml import closest
from scenario_publisher import scenario as scenarios
from scenario_publisher.scenario import Scenario

ROLES = ('controller', 'plant')
IN_MEMORY = 'the given scenario'  # begins errors about a scenario that is no file
# from this many drives on, a process per core pays for its start
MANY = 16

ScenarioLike = str | os.PathLike[str] | Scenario | Mapping[str, Any]
NameOrFile = str | os.PathLike[str]
NOTHING: Mapping[str, Any] = {}


def drive(
    scenario: ScenarioLike,
    controller: NameOrFile = 'mpcc',
    settings: Mapping[str, Any] = NOTHING,
    *,
    plant: NameOrFile | None = None,
    any_car: bool = False,
    label: str = '',
) -> Run:
    """Simulate a scenario with a controller, in lockstep and without ROS, and return the run.

    scenario    a name in scenarios/, a YAML file, a Scenario, or the content of such a file
    controller  a name in mpcc_controller/config, or a YAML file
    settings    parameters by dotted name, as of `--set`: `controller.tolerances.contouring_m`,
                `plant.friction`; also `scenario.speed_mps`, a constant desired speed [m/s], and
                `scenario.friction` of the road, which the controller assumes, too
    plant       a name in vehicle_plant/config, or a YAML file: another car; the controller needs
                what `identify` writes for it, as `controller.car_file`
    any_car     whether to drive also where the controller's car file is that of another car
    label       of the run in tables and figures; by default the controller, and what was set

    Raises BagError for what is unknown or out of range; the message names it and what is allowed.
    """
    task = _Task(scenario, controller, _with_plant(settings, plant), any_car)
    label = label or task.label(task.settings)
    _check_problems([task])
    return task.run_of(_simulate(task.setup), label)


def drive_many(
    scenario: ScenarioLike | Sequence[ScenarioLike],
    controller: NameOrFile | Sequence[NameOrFile] = 'mpcc',
    settings: Mapping[str, Sequence[Any]] | Sequence[Mapping[str, Any]] = (NOTHING,),
    *,
    plant: NameOrFile | Sequence[NameOrFile] | None = None,
    any_car: bool = False,
    jobs: int | None = None,
) -> RunSet:
    """Simulate every combination of scenarios, controllers, settings and plants.

    Each of `scenario`, `controller` and `plant` is one, as of `drive`, or a list. `settings` are
    either lists of values by name, of which every combination is driven, or a list of settings as
    of `drive`, `any_car` is as there. Every input is checked before the first drive. `jobs`
    processes share the drives; by default one process does few drives, and one per usable core does
    many. Results do not depend on it. Labels say what differs.

    Raises BagError as `drive`, and for an empty list.
    """
    plants = [None] if plant is None else _listed(plant, 'plant')
    tasks = [
        _Task(road, driver, _with_plant(chosen, car), any_car)
        for road, driver, chosen, car in product(
            _listed(scenario, 'scenario'),
            _listed(controller, 'controller'),
            _combinations(settings),
            plants,
        )
    ]
    _check_problems(tasks)
    varied = _varied(tasks)
    several_roads = len({task.setup.scn.name for task in tasks}) > 1
    labels = [task.label(varied, several_roads) for task in tasks]
    columns = _simulate_all([task.setup for task in tasks], jobs)
    return RunSet(task.run_of(*driven) for task, *driven in zip(tasks, columns, labels))


class _Task:
    """One drive, checked but for the problem of its controller (`_check_problems`)."""

    def __init__(self, scenario, controller, settings, any_car):
        self.settings = {name: _plain(value) for name, value in settings.items()}
        changes, by_role = _split(self.settings)
        origins = {
            role: {name: _written(f'{role}.{name}') for name in values}
            for role, values in by_role.items()
        }
        scn, source = _load(scenario, changes)
        self.setup = simulation.prepare_scenario(
            scn, os.fspath(controller), by_role, source, origins, any_car
        )
        self.problem = self.setup.params, self.setup.vehicle, os.fspath(controller)

    def label(self, shown: Iterable[str], with_scenario: bool = False) -> str:
        """Return the controller, and the settings `shown` that this drive has."""
        chosen = {name: self.settings[name] for name in shown if name in self.settings}
        ends = [name.rpartition('.')[2] for name in chosen]
        texts = [
            f'{end if ends.count(end) == 1 else name}={_short(value)}'
            for end, (name, value) in zip(ends, chosen.items())
        ]
        road = [f'in {self.setup.scn.name}'] if with_scenario else []
        return ', '.join((' '.join((self.setup.controller, *road)), *texts))

    def run_of(self, columns: Mapping[str, Columns], label: str) -> Run:
        """Return the run of the columns that the simulation gave."""
        setup = self.setup
        source = f'{setup.controller} in {setup.scn.name}'
        info = simulation.run_info(setup)
        return Run(columns, source, info, label, self.settings)


def _check_problems(tasks: Iterable[_Task]) -> None:
    """Build the problem of each controller, equal ones once. Raises BagError."""
    for params, vehicle, controller in dict.fromkeys(task.problem for task in tasks):
        inputs.check_problem({inputs.CONTROLLER: (params, vehicle)}, controller)


def _simulate(setup: Setup) -> dict[str, Columns]:
    return simulation.run(setup)


def _simulate_all(setups, jobs) -> list[dict[str, Columns]]:
    cores = len(os.sched_getaffinity(0))
    if jobs is None:
        jobs = cores if len(setups) >= MANY else 1
    if isinstance(jobs, bool) or not isinstance(jobs, int) or jobs < 1:
        raise BagError(f'jobs: is {jobs!r}; allowed a whole number from 1')
    if jobs == 1:
        return [_simulate(setup) for setup in setups]
    with WorkerPool(min(jobs, len(setups))) as pool:
        return pool.run(_simulate, [(setup,) for setup in setups], lambda: None)


def _load(given: ScenarioLike, changes: Mapping[str, float]) -> tuple[Scenario, str]:
    """Return a scenario and its source, for errors. Raises BagError."""
    if isinstance(given, str | os.PathLike):
        return inputs.load_scenario(os.fspath(given), **changes), os.fspath(given)
    try:
        if isinstance(given, Scenario):
            return inputs.change_scenario(given, given.name, **changes), given.name
        if not isinstance(given, Mapping):
            raise BagError(
                f'scenario: is {given!r}; allowed a name, a file, a Scenario, '
                'or the content of a scenario file as a mapping'
            )
        scn = scenarios.parse(yaml.safe_dump(_plain(given), sort_keys=False), IN_MEMORY)
        return inputs.change_scenario(scn, IN_MEMORY, **changes), IN_MEMORY
    except scenarios.ScenarioError as error:
        raise BagError(str(error)) from None


def _split(settings) -> tuple[dict[str, float], dict[str, dict[str, Any]]]:
    """Return what changes the scenario, and the parameters of the nodes by role."""
    changes: dict[str, float] = {}
    by_role: dict[str, dict[str, Any]] = {}
    for name, value in settings.items():
        role, _, parameter = name.partition('.')
        if name in CHANGES:
            changes[CHANGES[name]] = _in_range(name, value)
        elif role in ROLES and parameter:
            by_role.setdefault(role, {})[parameter] = value
        else:
            allowed = ', '.join((*(f'{role}.*' for role in ROLES), *CHANGES))
            hint = closest(name, CHANGES) or set_option.closest_setting(name)
            raise BagError(f'settings: unknown name {name!r}{hint}; allowed {allowed}')
    return changes, by_role


def _in_range(name, value):
    """Return a number that the scenario allows. Raises BagError."""
    kind, rule = get_args(SCENARIO_SETTINGS[name])
    fault = rule.fault(kind, value)
    if fault:
        raise BagError(f'{_written(name)}: {fault} {value!r}; allowed {rule.allowed}')
    return float(value)


def _written(name: str) -> str:
    """Return how a script writes a setting, for errors."""
    return 'plant=' if name == PLANT_FILE else f'settings[{name!r}]'


def _with_plant(settings, plant) -> dict[str, Any]:
    if not isinstance(settings, Mapping):
        raise BagError(f'settings: must be a mapping of names to values, is {settings!r}')
    return {**settings} if plant is None else {**settings, PLANT_FILE: _plant_file(plant)}


def _plant_file(plant) -> str:
    """Return a path, or the file in vehicle_plant/config of a name without an ending."""
    given = os.fspath(plant)
    shipped = share.path('vehicle_plant', 'config')
    is_name = os.sep not in given and (shipped / f'{given}.yaml').is_file()
    return f'{given}.yaml' if is_name else given


def _combinations(settings) -> list[Mapping[str, Any]]:
    """Return the settings of each drive. Raises BagError."""
    if not isinstance(settings, Mapping):
        return _listed(settings, 'settings')
    values = [_listed(choices, f'settings: {name}') for name, choices in settings.items()]
    return [dict(zip(settings, chosen)) for chosen in product(*values)]


def _listed(given, name) -> list:
    """Return the elements of a list, or the one thing that is given."""
    if isinstance(given, np.ndarray):
        given = given.tolist()
    # a Scenario is a tuple
    is_single = isinstance(given, str | os.PathLike | Mapping | Scenario) or not isinstance(
        given, Iterable
    )
    chosen = [given] if is_single else list(given)
    if not chosen:
        raise BagError(f'{name}: is an empty list; allowed at least one')
    return chosen


def _varied(tasks) -> list[str]:
    """Return the settings that are not the same in all tasks, in their order."""
    names = dict.fromkeys(name for task in tasks for name in task.settings)
    missing = object()
    return [n for n in names if len({repr(t.settings.get(n, missing)) for t in tasks}) > 1]


def _plain(value: Any) -> Any:
    """Return a value as YAML has it: numbers of numpy and paths as numbers and words."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, Mapping):
        return {name: _plain(member) for name, member in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(member) for member in value]
    return value


def _short(value) -> str:
    """Return a value of a setting in a label."""
    return f'{value:g}' if isinstance(value, float) else str(value)
