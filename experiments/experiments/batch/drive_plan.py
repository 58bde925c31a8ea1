"""The drives of a study: the full grid of its values, in the order of the file, times the runs.

Run 1 is as configured. Further runs differ in entry speed and grip, by the draws of
`experiments study` (run k is draw k - 1): run k has the same perturbation for every scenario,
controller and setting, so drives of one number are pairs, and a longer batch begins with the runs
of a shorter one.
"""

from collections.abc import Sequence
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

from bags.errors import BagError
from experiments import simulation
from experiments.batch.study_file import SCENARIO_SPEED, Setting, StudyFile
from experiments.configuration import inputs, node_config
from experiments.configuration.inputs import KPH
from experiments.simulation import Setup
from experiments.study import run_spec
from node_runtime import provenance
from vehicle_plant import initial_state


class Combination(NamedTuple):
    """One scenario and controller with one value of every setting."""

    scenario: str  # a name, or the path of a file
    controller: str  # the path of its file
    settings: tuple[tuple[str, Any], ...]

    def __str__(self) -> str:
        changed = ''.join(f', {name}={value}' for name, value in self.settings)
        return f'{self.controller} in {self.scenario}{changed}'

    @property
    def formulation(self) -> str:
        """Equal for combinations whose controllers solve equal problems."""
        own = [pair for pair in self.settings if pair[0].startswith('controller.')]
        return repr((self.controller, own))


class Perturbation(NamedTuple):
    """What changes from run to run."""

    speed_kph: float  # of the entry speed; desired speeds change in proportion
    grip: float  # of the plant, over that of the scenario; the controller assumes the latter


NOMINAL = Perturbation(0.0, 1.0)


def combine(study: StudyFile) -> list[Combination]:
    """Return every combination, the last setting changing first. Raises BagError."""
    try:
        controllers = node_config.find_controllers(study.controllers)
    except BagError as error:
        raise BagError(f'{study.path}: controllers: {error}') from None
    names = [setting.name for setting in study.settings]
    values = [setting.values for setting in study.settings]
    return [
        Combination(scenario, str(controller.config), tuple(zip(names, chosen)))
        for scenario, controller, *chosen in product(study.scenarios, controllers, *values)
    ]


def prepare(combination: Combination) -> Setup:
    """Return the setup of the first run. Raises BagError for unusable input."""
    settings: dict[str, dict[str, Any]] = {}
    speed_mps = None
    for name, value in combination.settings:
        role, _, parameter = name.partition('.')
        if name == SCENARIO_SPEED:
            speed_mps = value
        else:
            settings.setdefault(role, {})[parameter] = value
    setup = simulation.prepare(combination.scenario, combination.controller, settings)
    if speed_mps is None:
        return setup
    return setup._replace(scn=_scenario_at_speed(combination.scenario, speed_mps))


@lru_cache(maxsize=256)
def _scenario_at_speed(scenario, speed_mps):
    return inputs.load_scenario(scenario, speed_mps)


def locate_error(study: StudyFile, combination: Combination, error: BagError) -> BagError:
    """Return the error of `prepare` with the place in the file that causes it."""
    try:
        inputs.load_scenario(combination.scenario)
    except BagError as alone:
        return BagError(f'{study.path}: scenarios: {alone}')
    try:
        prepare(combination._replace(settings=()))
    except BagError as alone:
        return BagError(f'{study.path}: controllers: {alone}')
    for setting, (name, value) in zip(study.settings, combination.settings):
        try:
            prepare(combination._replace(settings=((name, value),)))
        except BagError as alone:
            return BagError(str(_item(setting, value).error(str(alone))))
    return BagError(f'{study.path}: {combination}: {error}')


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


def drive_keys(setup: Setup, perturbations: Sequence[Perturbation]) -> list[str]:
    """Return what identifies each run of a setup: two drives with one key have equal results."""
    base = run_spec.cache_key(setup)
    return [provenance.digest(f'{base} {tuple(perturbation)}') for perturbation in perturbations]
