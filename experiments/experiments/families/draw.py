"""Draws of the families: (family, seed, index, difficulty) -> scenario file.

A draw depends on nothing but these four: not on other draws, their order or number. The random
numbers are those of Python's Mersenne Twister, seeded by the text of the four, which every version
of Python repeats.

Nominal draws are redrawn until the closed forms in `feasibility` hold. Hard draws are not: what of
them can be mastered at all is another question. They also have what a controller does not receive
(`Draw.settings`): a friction between 0.5 and 1 that it believes to be 1, commands that arrive late,
and errors of measurement. A draw in which another car accelerates beyond this friction is redrawn.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from inspect import isfunction
from itertools import chain
from types import MappingProxyType, ModuleType
from typing import Any, NamedTuple

import numpy as np
import yaml

from experiments.families import emergencies, feasibility, lane_change_task, traffic
from experiments.families.scenario_document import Document, ImpossibleError, Trial, rounded
from scenario_publisher import scenario
from scenario_publisher.scenario import Scenario
from scenario_publisher.waypoint_track import motion_at

NOMINAL, HARD = 'nominal', 'hard'
DIFFICULTIES = (NOMINAL, HARD)
Family = Callable[[Trial], Document]


def _families(module: ModuleType) -> dict[str, Family]:
    """Return the public functions of a module by name."""
    return {
        name: member
        for name, member in vars(module).items()
        if isfunction(member) and member.__module__ == module.__name__ and not name.startswith('_')
    }


FAMILIES = _families(emergencies)
# drives among others on roads that bend: of the library where they are named
TRAFFIC = _families(traffic)
LIBRARY = FAMILIES | TRAFFIC
# those of the library, and tasks of the study of tuned controllers
DRAWN = LIBRARY | {lane_change_task.NAME: lane_change_task.lane_change_task}
# whose draws differ from those of another family in one thing only
PAIRED = {'unforeseen_pedestrian': 'hidden_pedestrian'}
MAX_TRIALS = 10_000  # of a draw
MOTION_STEP_S = 0.1  # of the positions from which accelerations of others follow
HARD_FRICTION = (0.5, 1.0)
BELIEVED_FRICTION = 1.0
HARD_DELAY_MS = (0, 40)  # of commands
# of measurements, uniform to either side
HARD_BIASES = {
    'ahead_bias_m': 0.3,
    'left_bias_m': 0.15,
    'speed_error': 0.02,  # share of the speed
    'sideslip_bias_rad': 0.01,
}
HARD_NOISE = {
    'position_noise_m': 0.02,
    'yaw_noise_rad': 0.002,
    'yaw_rate_noise_radps': 0.01,
    'obstacle_noise_m': 0.05,
    'obstacle_dropout': 0.05,  # share of the time
}


class Draw(NamedTuple):
    """One emergency."""

    family: str
    seed: int
    index: int
    difficulty: str
    text: str  # the scenario file
    # parameters beside those of the scenario, by role and dotted name as of --set
    settings: Mapping[str, Mapping[str, Any]]
    values: Mapping[str, Any] = MappingProxyType({})  # columns of a table: what was drawn of a task

    @property
    def name(self) -> str:
        """Name of its scenario."""
        return f'{self.family}_{self.difficulty}_s{self.seed}_{self.index}'

    def __repr__(self) -> str:
        return f'Draw({self.name})'

    def scenario(self) -> Scenario:
        """Return its checked scenario."""
        return scenario.parse(self.text, f'{self.name}.yaml')


def draw(family: str, seed: int, index: int, difficulty: str = NOMINAL) -> Draw:
    """Return one draw of a family.

    seed, index  whole numbers from 0: a set of draws, and the number of the draw in it
    difficulty   'nominal' or 'hard'

    Raises ValueError for an unknown family or difficulty, and for numbers below 0.
    """
    if family not in DRAWN:
        raise ValueError(f'no family {family!r}; there are {", ".join(DRAWN)}')
    if difficulty not in DIFFICULTIES:
        raise ValueError(f'no difficulty {difficulty!r}; there are {", ".join(DIFFICULTIES)}')
    if min(seed, index) < 0:
        raise ValueError(f'seed and index must be 0 or more, are {seed} and {index}')
    trial = Trial(f'{PAIRED.get(family, family)} {difficulty} {seed} {index}')
    trial.hard = difficulty == HARD
    possible = _possible(DRAWN[family], trial)
    parts = next(possible, None)
    disturbances = None
    if trial.hard and parts is not None:
        friction, disturbances = rounded(trial.uniform(*HARD_FRICTION)), _disturbances(trial)
        on_road = (again | {'friction': friction} for again in chain([parts], possible))
        parts = next((again for again in on_road if _others_hold_the_road(again)), None)
    if parts is None:
        raise RuntimeError(f'{family}: none of {MAX_TRIALS} draws is possible')
    settings = parts.pop(lane_change_task.SETTINGS, {})
    values = parts.pop(lane_change_task.VALUES, {})
    if disturbances is not None:
        settings = disturbances
    drawn = Draw(family, seed, index, difficulty, '', settings, values)
    parts['name'] = drawn.name
    return drawn._replace(
        text=yaml.safe_dump(parts, sort_keys=False, default_flow_style=None, width=100)
    )


def _possible(family, trial):
    """Yield the documents of the trials that a car can master."""
    for _ in range(MAX_TRIALS):
        with suppress(ImpossibleError):
            yield family(trial)


def _others_hold_the_road(parts):
    """Return whether nobody on the road accelerates by more than its friction allows."""
    beside = (lane_change_task.SETTINGS, lane_change_task.VALUES)
    file = {key: value for key, value in parts.items() if key not in beside}
    scn = scenario.parse(yaml.safe_dump(file), 'draw.yaml')
    t = np.arange(0.0, scn.stop.time, MOTION_STEP_S)
    for track in (actor.track for actor in scn.actors if actor.track is not None):
        way = np.array(motion_at(track, t)[:2])
        acceleration = np.hypot(*np.diff(way, 2)) / MOTION_STEP_S**2
        if acceleration.max() > scn.friction * feasibility.GRAVITY:
            return False
    return True


def _disturbances(random):
    """Return the parameters, by role and dotted name, that make a draw hard."""
    biases = {name: random.uniform(-most, most) for name, most in HARD_BIASES.items()}
    errors = {'seed': random.randrange(2**31), **rounded(biases), **HARD_NOISE}
    return {
        'plant': {'command_delay_ms': random.randint(*HARD_DELAY_MS)},
        'controller': {
            'model.friction': BELIEVED_FRICTION,
            **{f'measurement_errors.{name}': value for name, value in errors.items()},
        },
    }
