"""One drive: a scenario or the draw of a family, a controller, settings, a start offset.

Batches, the library, searches and run files all consist of rows. A row is small and can be sent to
another process, or machine; there it is prepared and driven in process (`simulation.run`). Its key
identifies the result: two rows with one key have equal results, but for computing times.
"""

import hashlib
import json
import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import Annotated, Any, NamedTuple, get_args

import numpy as np

from bags.errors import BagError
from bags.evaluation import metrics
from bags.evaluation.drive import drive_from_columns
from bags.evaluation.metrics.registry import flatten
from experiments import code_version, simulation
from experiments.configuration import inputs, node_config, set_option
from experiments.configuration.inputs import KPH
from experiments.families import draw as families
from experiments.simulation import Setup
from msgs_yaml import share
from msgs_yaml.strict_yaml import Choice, closest, leaf_of
from node_runtime.parameters import SPEED
from scenario_publisher import scenario, schema
from scenario_publisher.scenario import Scenario
from vehicle_plant import initial_state

SCENARIO_SPEED = 'scenario.speed_mps'  # replaces the desired speed by a constant
SCENARIO_FRICTION = 'scenario.friction'  # of the road; the controller assumes it, too
# after the dot, arguments of inputs.change_scenario
SCENARIO_SETTINGS = {
    SCENARIO_SPEED: Annotated[float, SPEED],
    SCENARIO_FRICTION: schema.Friction,
    'scenario.predictions': Annotated[str, Choice(*get_args(schema.Predictions))],
}
ROLES = ('controller', 'plant', 'estimator')
SENSORS, SENSORS_SEED = 'sensors', 'sensors_seed'  # of the plant
ANY_ROAD = 'straight'  # where only parameters matter
CHANGED = 'changed since the command began; repeat it'
SOLVED = 'solved'
Pairs = tuple[tuple[str, Any], ...]  # names and values of settings


class Offset(NamedTuple):
    """What changes from run to run."""

    speed_kph: float = 0.0  # of the entry speed; desired speeds change in proportion
    grip: float = 1.0  # of the plant, over that of the scenario; the controller assumes the latter


NOMINAL = Offset()


class Row(NamedTuple):
    """All that is chosen about a drive."""

    scenario: str  # a name, the path of a file, or FAMILY:INDEX, a draw of a family
    controller: str  # a name, or the path of a file
    # NODE.parameter and its value, SCENARIO_SETTINGS too. The last one of a name counts, and each
    # wins over those of a draw
    settings: Pairs = ()
    seed: int = 0  # of the draw of a family
    difficulty: str = families.NOMINAL  # likewise
    offset: Offset = NOMINAL  # of the start
    knows_limit: bool = True  # whether what the plant holds in a steady turn is found, if it does
    labels: Pairs = ()  # columns of the table that decide nothing

    def __str__(self) -> str:
        changed = ''.join(f', {name}={value}' for name, value in self.settings)
        return f'{self.controller} in {self.scenario}{changed}'

    @property
    def draw(self) -> families.Draw | None:
        """The draw of a family without its text and settings, None for a scenario."""
        family, colon, index = self.scenario.partition(':')
        if not colon or family not in families.DRAWN or not index.isdecimal():
            return None
        return families.Draw(family, self.seed, int(index), self.difficulty, '', {})

    @property
    def words(self) -> Pairs:
        """The settings that are words: some parameters name files."""
        return tuple(
            (name, value)
            for name, value in self.settings
            if any(isinstance(part, str) for part in (value if _is_list(value) else [value]))
        )

    @property
    def formulation(self) -> str:
        """Equal for rows whose controllers may solve equal problems.

        Numbers are taken for parameters of a problem, which do not change it.
        """
        own = [pair for pair in self.words if pair[0].startswith('controller.')]
        return repr((self.controller, own))

    def columns(self) -> dict[str, Any]:
        """Return what tells this row apart, by the name of its column in a table."""
        scene = self.draw
        is_file = scene is None and Path(self.scenario).suffix
        return {
            'scenario': _scenario_of_file(self.scenario).name if is_file else self.scenario,
            'family': scene and scene.family,
            'difficulty': scene and scene.difficulty,
            'seed': scene and scene.seed,
            'draw': scene and scene.index,
            'controller': _controller_name(self.controller),
            **{name: list(v) if _is_list(v) else v for name, v in self.settings},
            **dict(self.labels),
            **{f'offset.{name}': value for name, value in self.offset._asdict().items()},
        }


def _is_list(value):
    return isinstance(value, list | tuple)


@cache
def _controller_name(name_or_path):
    """Return the name in tables: a file that is called like a controller of the package is a path.

    Else its drives would be counted with those of that controller.
    """
    name = Path(name_or_path).stem
    shipped = share.path('mpcc_controller', 'config') / f'{name}.yaml'
    return name_or_path if shipped.is_file() else name


def as_pairs(settings: Sequence[str]) -> Pairs:
    """Return the settings of `--set NODE.parameter=value` texts. Raises BagError."""
    pairs = tuple(
        (f'{role}.{name}', tuple(value) if isinstance(value, list) else value)
        for role, values in set_option.parse_overrides(settings).items()
        for name, value in values.items()
    )
    split_settings(dict(pairs), '--set', '--set {}'.format)
    return pairs


def split_settings(
    settings: Mapping[str, Any],
    source: str = 'settings',
    written: Callable[[str], str] = '{}'.format,
) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Return what changes the scenario, and the parameters of the nodes by role.

    Raises BagError, which begins with `source`, for a name of no node, and for a value of
    SCENARIO_SETTINGS out of range, which begins with `written(name)`.
    """
    changes: dict[str, Any] = {}
    by_role: dict[str, dict[str, Any]] = {}
    for name, value in settings.items():
        role, _, parameter = name.partition('.')
        if name in SCENARIO_SETTINGS:
            if fault := leaf_of(SCENARIO_SETTINGS[name]).fault(value):
                raise BagError(f'{written(name)}: {fault}')
            changes[parameter] = value if isinstance(value, str) else float(value)
        elif role in ROLES and parameter:
            by_role.setdefault(role, {})[parameter] = value
        else:
            allowed = ', '.join((*(f'{role}.*' for role in ROLES), *SCENARIO_SETTINGS))
            hint = closest(name, SCENARIO_SETTINGS)
            hint = hint or ('' if role in node_config.ROLES else set_option.closest_setting(name))
            raise BagError(f'{source}: unknown name {name!r}{hint}; allowed {allowed}')
    return changes, by_role


def prepare(row: Row, any_car: bool = False, written: Callable[[str], str] = '{}'.format) -> Setup:
    """Return the setup of a row; `written` says how the user wrote a setting, for errors.

    Raises BagError for unusable input, and, unless `any_car`, for a plant that is another car than
    the controller knows.
    """
    changes, settings = split_settings(dict(row.settings))
    scn, drawn = _load(row, changes)
    for role, values in drawn.items():
        settings[role] = {**values, **settings.get(role, {})}
    if row.draw and SENSORS in settings.get('plant', ()):  # each draw is measured anew
        number = zlib.crc32(repr(row.draw[:3]).encode()) >> 1
        settings['plant'] = {SENSORS_SEED: number, **settings['plant']}
    source = scn.name if row.draw else row.scenario
    setup = simulation.prepare_scenario(scn, row.controller, settings, source, written, any_car)
    setup = setup._replace(knows_limit=row.knows_limit)
    if row.offset == NOMINAL:
        return setup
    start, reference = scn.start, scn.reference
    # a car that starts at standstill still does; the desired speeds change all the same
    base = start.speed or float(initial_state.start_from_reference(reference).speed)
    speed = base + row.offset.speed_kph / KPH
    scn = scn._replace(
        start=start._replace(speed=speed) if start.speed else start,
        reference=reference._replace(t=reference.t * (base / speed)),
    )
    friction = tuple(row.offset.grip * value for value in scn.patches.friction)
    scn = scn._replace(patches=scn.patches._replace(friction=friction))
    return setup._replace(scn=scn, friction=setup.friction * row.offset.grip)


def _load(row, changes) -> tuple[Scenario, Mapping[str, Mapping[str, Any]]]:
    """Return the changed scenario of a row, and the parameters that a draw sets, by role."""
    if row.draw is None:
        return inputs.load_scenario(row.scenario, **changes), {}
    draw = _draw(*row.draw[:4])
    return inputs.change_scenario(draw.scenario(), draw.name, **changes), draw.settings


# searches drive the same draws again and again
_draw = lru_cache(maxsize=256)(families.draw)


def key(row: Row) -> str:
    """Return the SHA-256 of all that decides a row: scenario, parameters, code, processor.

    The files of scenario and parameters count by their content, as they were when this program
    read them for the first key (`forget_files`).
    """
    decided = (
        code_version.digest(),
        _files(row.controller, row.words),
        row.draw or _text(row.scenario),
        sorted(dict(row.settings).items()),
        row.offset,
        row.knows_limit,
    )
    return hashlib.sha256(repr(decided).encode()).hexdigest()


@cache
def _files(controller, words):
    """Return the parameters of controller, car and plant with the settings that are words."""
    setup = prepare(Row(ANY_ROAD, controller, words), any_car=True)
    return repr(
        (setup.controller, setup.params, setup.vehicle, setup.plant, setup.sensors, setup.estimator)
    )


@cache
def _text(name_or_path):
    return inputs.load_scenario(name_or_path).text


_scenario_of_file = cache(scenario.load)


def forget_files() -> None:
    """Let the next keys read files again, which may have changed."""
    _files.cache_clear()
    _text.cache_clear()
    _scenario_of_file.cache_clear()


def drive(setup: Setup) -> dict[str, Any]:
    """Simulate once; return the results of the drive by dotted name, ready for JSON.

    These are the metrics under their names in comparison.json, `verdict` among them, the record of
    the solver (`solver.*`), the friction of the scenario, and the wall and processor time [s] of
    the drive and its evaluation.
    """
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    columns = simulation.run(setup, explain=False)
    driven = drive_from_columns(columns, simulation.run_info(setup), setup.controller)
    reports = [why.values for why in columns['/controller/why'].values]
    values = {'friction': setup.scn.friction}
    values |= flatten({**metrics.compute_metrics(driven), 'solver': solver_statistics(reports)})
    values['wall_s'] = time.perf_counter() - wall_s
    values['cpu_s'] = time.process_time() - cpu_s
    return values


def drive_unchanged(
    row: Row, wanted: str, drive_setup: Callable[[Setup], dict[str, Any]] = drive
) -> str:
    """Drive a row whose key was `wanted` when it was planned; return its results as JSON.

    Raises BagError where it is another by now: the results would be kept under a false key.
    """
    forget_files()
    setup = prepare(row, any_car=True)  # the program has refused what must not be driven
    if key(row) != wanted:
        raise BagError(f'{row}: a file of its inputs has {CHANGED}')
    return json.dumps(drive_setup(setup), allow_nan=False)


def solver_statistics(reports: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return statistics of the first solver over the ticks that called it, None without any.

    `failed` counts the ticks in which it did not converge to its tolerance. `reports` are the
    values of /controller/why.
    """
    solves = [report for report in reports if 'solver.iterations' in report]
    failed = sum(report['solver.status'] != SOLVED for report in solves)
    values = {'asked': len(solves), 'failed': failed}
    if not solves:
        names = ('failed_share', 'iterations_mean', 'iterations_p99', 'iterations_max')
        return values | dict.fromkeys((*names, 'time_per_iteration_ms'))
    iterations = np.array([report['solver.iterations'] for report in solves], dtype=float)
    time_ms = sum(report['time.solve_cpu_ms'] for report in solves)
    return {
        **values,
        'failed_share': failed / len(solves),
        'iterations_mean': float(iterations.mean()),
        'iterations_p99': float(np.percentile(iterations, 99)),
        'iterations_max': int(iterations.max()),
        'time_per_iteration_ms': time_ms / int(iterations.sum()) if iterations.sum() else None,
    }
