"""Two stages of Bayesian optimisation with optuna: tree-structured Parzen estimators.

Optuna's ask-and-tell interface is used in batches of a fixed size, and every trial has a random
generator of its own, seeded by the plan. So the trials depend on plan and code only, not on the
number of processes. Drives are kept: an interrupted search asks for the same rows again, and drives
those that are missing. The first trials of a longer stage are those of a shorter one.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import optuna
import pandas
from optuna.distributions import FloatDistribution
from optuna.samplers import TPESampler

from experiments import code_version, drive_row
from experiments.drive_records import DriveRecords
from experiments.drive_row import SCENARIO_SPEED
from experiments.pool import Pool
from experiments.tuning import problem
from experiments.tuning.problem import Condition, Score

DIGITS = 4  # significant; more would claim a precision that a search over chaotic runs lacks


class SearchPlan(NamedTuple):
    """All that decides a search, apart from the code."""

    controller: str
    seed: int
    trials: tuple[int, int]  # of each stage, including its given first trial
    random: tuple[int, int]  # of them, drawn at random before the model chooses
    batch: int  # trials asked for before the model gets their results
    conditions: tuple[Condition, ...]
    tracking_m: float  # bound on the rms distance from the coarse path

    @property
    def runs(self) -> int:
        """The number of simulations."""
        return sum(self.trials) * len(self.conditions)


class Trial(NamedTuple):
    """One set of weights with its results."""

    stage: int
    number: int  # within the stage; 0 is the untuned set, or the best of stage 1
    weights: dict[str, float]  # by dotted name
    scores: tuple[Score, ...]  # one per condition
    violations: tuple[float, ...]  # of problem.CONSTRAINTS

    @property
    def cost(self) -> float:
        """The objective."""
        return problem.cost(self.scores)

    @property
    def is_feasible(self) -> bool:
        """Whether every run kept all distances, was completed and tracked the path."""
        return max(self.violations) <= 0.0


def run(
    plan: SearchPlan,
    folder: Path,
    pool: Pool,
    on_run: Callable[[], None],
    on_trial: Callable[[Trial], None],
) -> list[Trial]:
    """Search, or continue the search in `folder`; return every trial in order.

    `on_run()` is called after each simulation, `on_trial(trial)` after each trial. Raises BagError
    for a drive without a result, and while another program searches in the folder.
    """
    trials: list[Trial] = []
    first = problem.untuned_weights(plan.controller)
    spans = problem.wide_spans(first)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    with DriveRecords(folder) as records:
        for stage in (1, 2):
            for trial in _run_stage(plan, stage, first, spans, records, pool, on_run):
                on_trial(trial)
                trials.append(trial)
            first = find_best(trials).weights
            spans = problem.narrow_spans(spans, first)
    return trials


def find_best(trials: Sequence[Trial]) -> Trial:
    """Return the feasible trial of least cost; without one that of the least violation."""
    return min(trials, key=lambda trial: (sum(trial.violations), trial.cost))


def _run_stage(
    plan: SearchPlan,
    stage: int,
    first: Mapping[str, float],
    spans: Mapping[str, FloatDistribution],
    records: DriveRecords,
    pool: Pool,
    on_run: Callable[[], None],
) -> Iterator[Trial]:
    """Yield the trials of a stage, batch by batch."""
    study = optuna.create_study(direction='minimize')
    # rounding may have left the range
    inside = {n: min(max(first[n], span.low), span.high) for n, span in spans.items()}
    study.enqueue_trial(inside)
    total = plan.trials[stage - 1]
    for begin in range(0, total, plan.batch):
        asked = []
        for number in range(begin, min(total, begin + plan.batch)):
            # seeded per trial: the first trials of a stage do not depend on their number
            seed = np.random.SeedSequence((plan.seed, stage, number)).generate_state(1)[0]
            study.sampler = TPESampler(seed=int(seed), n_startup_trials=plan.random[stage - 1])
            asked.append(study.ask(dict(spans)))
        # as in a tuned controller file
        weights = [
            {name: float(f'{value:.{DIGITS}g}') for name, value in trial.params.items()}
            for trial in asked
        ]
        rows = [
            problem.row_of(plan.controller, chosen, condition)
            for chosen in weights
            for condition in plan.conditions
        ]
        scores = iter(_drive(rows, records, pool, on_run))
        for trial, chosen in zip(asked, weights):
            own = tuple(next(scores) for _ in plan.conditions)
            violations = problem.violations(own, plan.tracking_m)
            for name, value in zip(problem.CONSTRAINTS, violations):
                trial.set_constraint(name, value)
            study.tell(trial, problem.cost(own))
            yield Trial(stage, trial.number, chosen, own, violations)


def _drive(rows, records, pool, on_run):
    """Return the score of each row, in their order; drive those that have none."""
    # of all that decides a score
    code = code_version.digest((*code_version.ROOTS, problem.__name__))
    keys = [hashlib.sha256(f'{drive_row.key(row)} {code}'.encode()).hexdigest() for row in rows]
    missing = {key: row for key, row in zip(keys, rows) if key not in records}
    tasks = [
        (
            row,
            drive_row.key(row),
            partial(problem.measure, speed_mps=dict(row.settings)[SCENARIO_SPEED]),
        )
        for row in missing.values()
    ]
    for ended in pool.finish_each(drive_row.drive_unchanged, tasks):
        if ended.error:
            raise ended.error
        records.add(list(missing)[ended.number], ended.value)
        on_run()
    return [Score(**json.loads(records[key])) for key in keys]


def as_table(trials: Sequence[Trial]) -> pandas.DataFrame:
    """Return the history: stage, number, cost, safe, weights, scores by condition."""
    return pandas.DataFrame(
        {
            'stage': trial.stage,
            'trial': trial.number,
            'cost': trial.cost,
            'safe': trial.is_feasible,
            **trial.weights,
            **{
                f'{name}.{k}': value
                for k, score in enumerate(trial.scores, start=1)
                for name, value in score._asdict().items()
            },
        }
        for trial in trials
    )
