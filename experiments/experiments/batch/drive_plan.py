"""The drives of a study: the full grid of its values, in the order of the file, draws and runs.

Draw k is point k of the scrambled Sobol points of what is drawn, and draw k of a family: it is the
same for every controller and setting. Run 1 is as configured. Further runs differ in entry speed
and grip, by the draws of `run_spec` (run k is draw k - 1): run k has the same perturbation
for every scenario, controller, setting and draw. Drives of one draw and run are pairs, and a longer
batch begins with the draws and runs of a shorter one.
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

from bags.errors import BagError
from experiments import simulation
from experiments.batch import distributions, run_spec
from experiments.batch.study_file import SCENARIO_FRICTION, SCENARIO_SPEED, Setting, StudyFile
from experiments.configuration import inputs, node_config
from experiments.configuration.inputs import KPH
from experiments.simulation import Setup
from node_runtime import provenance
from scenario_publisher import scenario
from scenario_publisher.families import draw as families
from vehicle_plant import initial_state

CAR = f'plant.{inputs.PLANT_CAR}'
PLANT_FILE = f'plant.{node_config.PLANT_DEFAULTS}'
INSIDE = 0.3819660113  # share of a distribution: a value that is no whole number
ANY_ROAD = 'straight'  # stands for the draws of a family where only parameters matter
Pairs = tuple[tuple[str, Any], ...]  # names and values of settings


class Family(NamedTuple):
    """A family of the scenario library, and which draws of it."""

    name: str
    seed: int
    difficulty: str

    def __str__(self) -> str:
        return self.name

    def draw(self, number: int) -> families.Draw:
        """Return a draw."""
        return families.draw(self.name, self.seed, number, self.difficulty)

    def scenario_name(self, number: int) -> str:
        """Return the name of the scenario of a draw."""
        return families.Draw(self.name, self.seed, number, self.difficulty, '', {}).name


class Combination(NamedTuple):
    """One scenario or family, and controller, with one value of every setting."""

    scenario: str | Family  # a name, the path of a file, or a family
    controller: str  # a name, or the path of a file
    settings: Pairs

    def __str__(self) -> str:
        changed = ''.join(f', {name}={value}' for name, value in self.settings)
        return f'{self.controller} in {self.scenario}{changed}'


class Draw(NamedTuple):
    """One draw of a study: its number, and the drawn values by name."""

    number: int
    values: Pairs

    @property
    def words(self) -> Pairs:
        """The drawn values that are words: some parameters name files."""
        return tuple(pair for pair in self.values if isinstance(pair[1], str))


class Perturbation(NamedTuple):
    """What changes from run to run."""

    speed_kph: float  # of the entry speed; desired speeds change in proportion
    grip: float  # of the plant, over that of the scenario; the controller assumes the latter


class Drive(NamedTuple):
    """One drive of a study; it can be sent to another process, or machine."""

    combination: Combination
    draw: Draw
    perturbation: Perturbation

    @property
    def formulation(self) -> str:
        """Equal for drives whose controllers may solve equal problems.

        Numbers are taken for parameters of a problem, which do not change it.
        """
        pairs = (*self.combination.settings, *self.draw.words)
        own = [pair for pair in pairs if pair[0].startswith('controller.')]
        return repr((self.combination.controller, own))


CHANGED = 'changed since the command began; repeat it'
NOT_DRAWN = Draw(0, ())
NOMINAL = Perturbation(0.0, 1.0)


def combine(study: StudyFile) -> list[Combination]:
    """Return every combination, the last setting changing first. Raises BagError."""
    try:
        controllers = node_config.find_controllers(study.controllers)
    except BagError as error:
        raise BagError(f'{study.path}: controllers: {error}') from None
    names = [setting.name for setting in study.settings]
    values = [setting.values for setting in study.settings]
    drawn = [Family(name, study.seed, study.difficulty) for name in study.families]
    return [
        Combination(road, controller.name_or_path, tuple(zip(names, chosen)))
        for road, controller, *chosen in product((*study.scenarios, *drawn), controllers, *values)
    ]


def sample_draws(study: StudyFile) -> list[Draw]:
    """Return the draws of a study, numbered."""
    drawn = {drawn.name: drawn.distribution for drawn in study.drawn}
    samples = distributions.sample(drawn, len(study.draws), study.seed, study.draws.start)
    return [Draw(number, tuple(values.items())) for number, values in zip(study.draws, samples)]


def draws_of(combination: Combination, draws: Sequence[Draw]) -> Sequence[Draw]:
    """Return the draws of a combination: all those of a study, one where nothing is drawn."""
    is_drawn = isinstance(combination.scenario, Family) or (draws and draws[0].values)
    return draws if is_drawn else (NOT_DRAWN,)


@lru_cache(maxsize=8)
def prepare(combination: Combination, draw: Draw = NOT_DRAWN) -> Setup:
    """Return the setup of the first run of a draw. Raises BagError for unusable input."""
    changes: dict[str, float] = {}
    settings: dict[str, dict[str, Any]] = {}
    road, source = combination.scenario, str(combination.scenario)
    if isinstance(road, Family):
        scene = road.draw(draw.number)
        source = scene.name
        settings = {role: dict(values) for role, values in scene.settings.items()}
    for name, value in (*combination.settings, *draw.values):
        role, _, parameter = name.partition('.')
        if name in CHANGES:
            changes[CHANGES[name]] = value
        else:
            settings.setdefault(role, {})[parameter] = value
    scn = _load(road, **changes) if isinstance(road, str) else _change(scene, changes)
    origins = {role: {name: f'{role}.{name}' for name in own} for role, own in settings.items()}
    # what a study varies, it varies on purpose: `describe_misfit` warns
    setup = simulation.prepare_scenario(
        scn, combination.controller, settings, source, origins, any_car=True
    )
    # a limit takes as long to find as a run, and that of a drawn car serves no other drive
    draws_car = any(name.startswith(CAR) for name, _ in draw.values)
    return setup._replace(knows_limit=not draws_car)


# arguments of inputs.load_scenario
CHANGES: Mapping[str, str] = {SCENARIO_SPEED: 'speed_mps', SCENARIO_FRICTION: 'friction'}


@lru_cache(maxsize=256)
def _load(name, speed_mps=None, friction=None):
    return inputs.load_scenario(name, speed_mps, friction)


def _change(draw, changes):
    try:
        return inputs.change_scenario(draw.scenario(), draw.name, **changes)
    except scenario.ScenarioError as error:
        raise BagError(str(error)) from None


def prepare_any(combination: Combination, words: Pairs = ()) -> Setup:
    """Return a setup with the parameters of a combination, of any draw. Raises BagError.

    That of a family is on another road. `words` are the drawn values that are no numbers.
    """
    return prepare(*_any_draw(combination, words))


def _any_draw(combination, words):
    road = ANY_ROAD if isinstance(combination.scenario, Family) else combination.scenario
    return combination._replace(scenario=road), Draw(0, words)


def describe_misfit(combination: Combination, words: Pairs) -> str:
    """Return a line about a plant file that is another car than the controller knows, '' for none.

    The file alone counts: single parameters of the plant's car are varied on purpose.
    """
    own, words = (
        tuple(pair for pair in pairs if not pair[0].startswith(CAR))
        for pairs in (combination.settings, words)
    )
    chosen = dict((*own, *words))
    if PLANT_FILE not in chosen:
        return ''
    setup = prepare_any(combination._replace(settings=own), words)
    reasons = inputs.car_mismatches(setup.params, setup.vehicle, setup.plant)
    if not reasons:
        return ''
    return (
        f'{PLANT_FILE}={chosen[PLANT_FILE]} is driven although car_file {setup.params.car_file} of '
        f'{setup.controller} does not fit it: {"; ".join(reasons)}; `identify --car` writes one '
        'for controller.car_file'
    )


def prepare_drive(drive: Drive) -> Setup:
    """Return the setup of a drive. Raises BagError for drawn values that a node refuses."""
    return perturb(prepare(drive.combination, drive.draw), drive.perturbation)


def locate_error(study: StudyFile, combination: Combination, error: BagError) -> BagError:
    """Return the error of `prepare_any` with the place in the file that causes it."""
    if isinstance(combination.scenario, str):
        try:
            inputs.load_scenario(combination.scenario)
        except BagError as alone:
            return BagError(f'{study.path}: scenarios: {alone}')
    try:
        prepare_any(combination._replace(settings=()))
    except BagError as alone:
        return BagError(f'{study.path}: controllers: {alone}')
    for setting, (name, value) in zip(study.settings, combination.settings):
        try:
            prepare_any(combination._replace(settings=((name, value),)))
        except BagError as alone:
            return BagError(str(_item(setting, value).error(str(alone))))
    return BagError(f'{study.path}: {combination}: {error}')


def check_drawn(study: StudyFile, combinations: Sequence[Combination]) -> None:
    """Raise BagError where a node refuses an end of what is drawn, or a choice, whoever drives.

    Values between the ends are within the range of a parameter, too; one of them tells whether it
    takes whole numbers only. Values that a node refuses only together cost the rows of their
    drives.
    """
    first = {combination.controller: combination for combination in reversed(combinations)}
    for drawn in study.drawn:
        for combination in first.values():
            for end in (*drawn.distribution.ends(), drawn.distribution.value(INSIDE)):
                pair = (drawn.name, end)
                changed = combination._replace(settings=(*combination.settings, pair))
                try:
                    prepare_any(changed)
                except BagError as error:
                    raise BagError(str(drawn.item.error(f'{end}: {error}'))) from None


def _item(setting: Setting, value):
    return next(item for known, item in zip(setting.values, setting.items) if known is value)


def draw_perturbations(runs: int, seed: int) -> list[Perturbation]:
    """Return the perturbation of every run; that of the first changes nothing."""
    if runs == 1:
        return [NOMINAL]
    draws = run_spec.draw_runs(runs - 1, seed)
    return [NOMINAL, *(Perturbation(draw.speed_kph, draw.grip) for draw in draws)]


def perturb(setup: Setup, perturbation: Perturbation) -> Setup:
    """Return the setup of a further run."""
    if perturbation == NOMINAL:
        return setup
    start, reference = setup.scn.start, setup.scn.reference
    # a car that starts at standstill still does; the desired speeds change all the same
    base = start.speed or float(initial_state.start_from_reference(reference).speed)
    speed = base + perturbation.speed_kph / KPH
    scn = setup.scn._replace(
        start=start._replace(speed=speed) if start.speed else start,
        reference=reference._replace(t=reference.t * (base / speed)),
    )
    return setup._replace(scn=scn, friction=setup.friction * perturbation.grip)


def base_key(combination: Combination, words: Pairs = ()) -> str:
    """Return what identifies the inputs of a combination, its files included. Raises BagError.

    The files of the parameters are read again: they may have changed since `prepare` did.
    """
    return run_spec.cache_key(prepare.__wrapped__(*_any_draw(combination, words)))


def prepare_unchanged(drive: Drive, base: str) -> Setup:
    """Return the setup of a drive whose `base_key` was `base` when the drives were planned.

    Raises BagError where it is another by now: the results would be kept under a false key.
    """
    setup = prepare_drive(drive)
    if base_key(drive.combination, drive.draw.words) != base:
        raise BagError(f'{drive.combination}: a file of its inputs has {CHANGED}')
    return setup


def drive_key(base: str, drive: Drive) -> str:
    """Return what identifies a drive: two drives with one key have equal results.

    `base` is the `base_key` of its combination and of the words that it draws.
    """
    road, decided = drive.combination.scenario, [base, drive.draw.values]
    if isinstance(road, Family):
        decided += [road, drive.draw.number]
    return provenance.digest(repr((*decided, tuple(drive.perturbation))))
