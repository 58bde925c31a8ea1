"""The tuned version of the baseline: tolerances for each range of S, on training geometries.

The search sees tracking, the desired speed and the missing safety distance, which is the quantity
of the claim `unsafe_area`; sideslip, braking and least speed do not enter. Training settings are
drawn by seeds of their own, and every seed is a search of its own, on other geometries.
"""

from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import optuna
from optuna.distributions import FloatDistribution
from optuna.samplers import TPESampler

from bags.errors import BagError
from bags.evaluation import metrics
from experiments.pool import Pool
from experiments.settings import arms, drive
from experiments.settings import setting as settings
from experiments.settings.preregistration import Preregistration
from experiments.settings.setting import Setting
from experiments.settings_analysis import tuned_table
from experiments.settings_analysis.tuned_table import Cell, Table

# the searched tolerances and the dimension of the study whose range each has
SEARCHED = {
    'tolerances.contouring_m': 'contouring_tolerance_m',
    'tolerances.velocity_mps': 'velocity_tolerance_mps',
    'tolerances.heading_rad': 'heading_tolerance_rad',
    'tolerances.steer_rate_radps': 'steer_rate_tolerance_radps',
    'tolerances.force_rate_nps': 'force_rate_tolerance_nps',
}
STRATA_OF_CELL = 2  # of S, that share tuned parameters
SEEDS = (101, 102, 103, 104, 105)  # none of which the study draws
GEOMETRIES = 6  # training settings of a cell and a seed
TRIALS, RANDOM, BATCH = 48, 16, 4
MAX_DRAWS = 4096  # Sobol points in which training settings are looked for
DIGITS = 4
# of the objective; our choice, the order of a lane's spare room and of a noticeable change of speed
CONTOURING_SCALE_M, VELOCITY_SCALE_MPS, MISSING_SCALE_M = 0.5, 3.0, 0.1
FAILED = 20.0  # of a drive that is not completed, touches something or leaves the road


class Size(NamedTuple):
    """The size of the searches."""

    seeds: tuple[int, ...] = SEEDS
    geometries: int = GEOMETRIES
    trials: int = TRIALS
    random: int = RANDOM


FULL = Size()


def cost(values: Mapping[str, Any], safe_obstacle: float, safe_edge: float, off: float) -> float:
    """Return the cost of a drive from its metrics, safety distances [m] and rms velocity error.

    The velocity error counts because a car that stands tracks best.
    """
    if not values['completed'] or values['collided'] or values['left_road']:
        return FAILED
    missing = sum(
        max(0.0, safe - least)
        for safe, least in ((safe_obstacle, values['min_v2o_m']), (safe_edge, values['min_v2e_m']))
    )
    return (
        values['rms_contouring_m'] / CONTOURING_SCALE_M
        + off / VELOCITY_SCALE_MPS
        + missing / MISSING_SCALE_M
    )


def drive_cost(plan: Preregistration, setting: Setting, tuned: Mapping[str, float]) -> float:
    """Drive a setting with tuned parameters and return the cost."""
    task = drive.plan_drive(plan, setting, arms.TUNED, tuned=tuned)
    try:
        driven, _ = drive.simulate(task)
        facts = driven.facts._replace(circles=setting.offsets, vehicle_radius=setting.radius)
        values = metrics.compute_metrics(driven._replace(facts=facts))
    except BagError:
        return FAILED
    off = float(np.sqrt(np.mean((driven.motion.vx - setting.speed) ** 2)))
    drawn = setting.values
    return cost(values, drawn['safety_obstacle_m'], drawn['safety_edge_m'], off)


def training_settings(
    plan: Preregistration, low: float, high: float, seed: int, count: int
) -> list[Setting]:
    """Return the first admissible settings of a seed whose S is in a range.

    Raises BagError when there are not so many among MAX_DRAWS points.
    """
    training: list[Setting] = []
    for number, values in enumerate(settings.draw(plan, seed, 0, MAX_DRAWS)):
        if not low <= values['S'] < high:
            continue
        built = settings.build(plan, number, values)
        if isinstance(built, Setting):
            training.append(built)
        if len(training) == count:
            return training
    raise BagError(
        f'{len(training)} training settings with S from {low:g} to {high:g}, not {count}'
    )


def cells_of(plan: Preregistration) -> list[tuple[float, float]]:
    """Return the ranges of S that share tuned parameters: neighbouring strata of the study."""
    ends = plan.strata.S[::STRATA_OF_CELL]
    last = plan.strata.S[-1]
    return list(pairwise(ends if ends[-1] == last else (*ends, last)))


def tune(
    plan: Preregistration,
    pool: Pool,
    on_cost: Callable[[], None],
    size: Size = FULL,
) -> tuple[Table, list[dict[str, Any]]]:
    """Return the table of the tuned baseline, and a row per cell and seed of what was found.

    `on_cost()` is called after every drive. Raises BagError when a cell has too few settings.
    """
    table, rows = [], []
    for low, high in cells_of(plan):
        sets = []
        for seed in size.seeds:
            training = training_settings(plan, low, high, seed, size.geometries)
            weights, best, first = _search(plan, training, seed, size, pool, on_cost)
            sets.append(weights)
            rows.append(
                {
                    'S_low': low,
                    'S_high': high,
                    'seed': seed,
                    'settings': [setting.number for setting in training],
                    'cost_matched': first,
                    'cost_tuned': best,
                    **weights,
                }
            )
        table.append(Cell(low, high, tuple(sets)))
    return tuple(table), rows


def _search(plan, training, seed, size, pool, on_cost):
    """Return the best parameters, their cost, and that of the settings' own tolerances."""
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    sampler = TPESampler(seed=seed, n_startup_trials=size.random, multivariate=True)
    study = optuna.create_study(sampler=sampler)
    ranges = {
        name: FloatDistribution(*plan.dimensions[dimension].ends(), log=True)
        for name, dimension in SEARCHED.items()
    }
    matched = pool.run(drive_cost, [(plan, setting, {}) for setting in training], on_cost)
    for count in _batches(size.trials):
        asked = [study.ask(ranges) for _ in range(count)]
        tasks = [(plan, setting, _rounded(trial.params)) for trial in asked for setting in training]
        costs = np.reshape(pool.run(drive_cost, tasks, on_cost), (count, len(training)))
        for trial, own in zip(asked, costs):
            study.tell(trial, float(own.mean()))
    return _rounded(study.best_params), float(study.best_value), float(np.mean(matched))


def _batches(trials) -> Iterator[int]:
    for done in range(0, trials, BATCH):
        yield min(BATCH, trials - done)


def _rounded(values):
    return {name: float(f'{value:.{DIGITS}g}') for name, value in values.items()}


def judge(
    plan: Preregistration,
    table: Table,
    seed: int,
    count: int,
    pool: Pool,
    on_cost: Callable[[], None],
) -> list[dict[str, float]]:
    """Return the cost of matched and tuned parameters on settings of a seed not tuned on.

    One row per setting, `count` in every cell.
    """
    fresh = [
        setting
        for cell in table
        for setting in training_settings(plan, cell.low, cell.high, seed, count)
    ]
    chosen = [
        tuned_table.parameters_of(table, setting.number, setting.values['S']) for setting in fresh
    ]
    tasks = [(plan, setting, {}) for setting in fresh]
    tasks += [(plan, setting, tuned) for setting, tuned in zip(fresh, chosen)]
    costs = pool.run(drive_cost, tasks, on_cost)
    return [
        {
            'setting': setting.number,
            'S': setting.values['S'],
            'cost_matched': matched,
            'cost_tuned': tuned,
        }
        for setting, matched, tuned in zip(fresh, costs, costs[len(fresh) :])
    ]
