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
from typing import Any

import numpy as np
import yaml

from bags.errors import BagError
from bags.run import Run
from bags.run_set import RunSet
from bags.storage.columns import Columns
from experiments import drive_row, simulation
from experiments.commands import SENSORS, sensors_file
from experiments.configuration import inputs, node_config
from experiments.pool import Pool
from msgs_yaml import share
from scenario_publisher import scenario as scenarios
from scenario_publisher.scenario import Scenario

PLANT_FILE = f'plant.{node_config.PLANT_DEFAULTS}'
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
    sensors: NameOrFile | None = None,
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
    sensors     of the car: consumer, automotive, survey, or a YAML file; None: truth alone

    Raises BagError for what is unknown or out of range; the message names it and what is allowed.
    """
    settings = _with_plant(settings, plant)
    if sensors is not None:
        settings[SENSORS] = sensors_file(os.fspath(sensors))
    task = _Task(scenario, controller, settings, any_car)
    label = label or task.label(task.settings)
    _check_problems([task])
    return task.run_of(simulation.run(task.setup), label)


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
    if isinstance(settings, Mapping):
        values = [_listed(choices, f'settings: {name}') for name, choices in settings.items()]
        settings = [dict(zip(settings, chosen)) for chosen in product(*values)]
    tasks = [
        _Task(road, driver, _with_plant(chosen, car), any_car)
        for road, driver, chosen, car in product(
            _listed(scenario, 'scenario'),
            _listed(controller, 'controller'),
            _listed(settings, 'settings'),
            plants,
        )
    ]
    _check_problems(tasks)
    names, missing = dict.fromkeys(name for task in tasks for name in task.settings), object()
    varied = [n for n in names if len({repr(t.settings.get(n, missing)) for t in tasks}) > 1]
    several_roads = len({task.setup.scn.name for task in tasks}) > 1
    labels = [task.label(varied, several_roads) for task in tasks]
    columns = _simulate_all([task.setup for task in tasks], jobs)
    return RunSet(task.run_of(*driven) for task, *driven in zip(tasks, columns, labels))


class _Task:
    """One drive, checked but for the problem of its controller (`_check_problems`)."""

    def __init__(self, scenario, controller, settings, any_car):
        self.settings = {name: _plain(value) for name, value in settings.items()}
        changes, by_role = drive_row.split_settings(self.settings, 'settings', _written)
        scn, source = _load(scenario, changes)
        self.setup = simulation.prepare_scenario(
            scn, os.fspath(controller), by_role, source, _written, any_car
        )
        self.problem = self.setup.params, self.setup.vehicle, os.fspath(controller)

    def label(self, shown: Iterable[str], with_scenario: bool = False) -> str:
        """Return the controller, and the settings `shown` that this drive has."""
        chosen = {name: self.settings[name] for name in shown if name in self.settings}
        ends = [name.rpartition('.')[2] for name in chosen]
        texts = [
            f'{end if ends.count(end) == 1 else name}='
            + (f'{value:g}' if isinstance(value, float) else str(value))
            for end, (name, value) in zip(ends, chosen.items())
        ]
        road = [f'in {self.setup.scn.name}'] if with_scenario else []
        return ', '.join((' '.join((self.setup.controller, *road)), *texts))

    def run_of(self, columns: Mapping[str, Columns], label: str) -> Run:
        """Return the run of the columns that the simulation gave."""
        source = f'{self.setup.controller} in {self.setup.scn.name}'
        return Run(columns, source, simulation.run_info(self.setup), label, self.settings)


def _check_problems(tasks: Iterable[_Task]) -> None:
    """Build the problem of each controller, equal ones once. Raises BagError."""
    for params, vehicle, controller in dict.fromkeys(task.problem for task in tasks):
        inputs.check_problem({inputs.CONTROLLER: (params, vehicle)}, controller)


def _simulate_all(setups, jobs) -> list[dict[str, Columns]]:
    cores = len(os.sched_getaffinity(0))
    if jobs is None:
        jobs = cores if len(setups) >= MANY else 1
    if isinstance(jobs, bool) or not isinstance(jobs, int) or jobs < 1:
        raise BagError(f'jobs: is {jobs!r}; allowed a whole number from 1')
    if jobs == 1:
        return [simulation.run(setup) for setup in setups]
    with Pool(min(jobs, len(setups))) as pool:
        return pool.run(simulation.run, [(setup,) for setup in setups])


def _load(given: ScenarioLike, changes: Mapping[str, float]) -> tuple[Scenario, str]:
    """Return a scenario and its source, for errors. Raises BagError."""
    if isinstance(given, str | os.PathLike):
        return inputs.load_scenario(os.fspath(given), **changes), os.fspath(given)
    if isinstance(given, Scenario):
        return inputs.change_scenario(given, given.name, **changes), given.name
    if not isinstance(given, Mapping):
        raise BagError(
            f'scenario: is {given!r}; allowed a name, a file, a Scenario, '
            'or the content of a scenario file as a mapping'
        )
    scn = scenarios.parse(yaml.safe_dump(_plain(given), sort_keys=False), IN_MEMORY)
    return inputs.change_scenario(scn, IN_MEMORY, **changes), IN_MEMORY


def _written(name: str) -> str:
    """Return how a script writes a setting, for errors."""
    return 'plant=' if name == PLANT_FILE else f'settings[{name!r}]'


def _with_plant(settings, plant) -> dict[str, Any]:
    if not isinstance(settings, Mapping):
        raise BagError(f'settings: must be a mapping of names to values, is {settings!r}')
    if plant is None:
        return {**settings}
    file, shipped = os.fspath(plant), share.path('vehicle_plant', 'config')
    if os.sep not in file and (shipped / f'{file}.yaml').is_file():
        file = f'{file}.yaml'  # of a name without an ending
    return {**settings, PLANT_FILE: file}


def _listed(given, name) -> list:
    """Return the elements of a list, or the one thing that is given."""
    if isinstance(given, np.ndarray):
        given = given.tolist()
    single = str | os.PathLike | Mapping | Scenario  # a Scenario is a tuple
    is_list = isinstance(given, Iterable) and not isinstance(given, single)
    chosen = list(given) if is_list else [given]
    if not chosen:
        raise BagError(f'{name}: is an empty list; allowed at least one')
    return chosen


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
