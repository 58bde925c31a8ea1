"""Search the settings for the one nearest to the paper's picture by Parzen estimators.

The search runs over the unit cube of the study's dimensions, so that every distribution of the
study is a prior of the search. Each trial has a random generator of its own and the sampler gets
results in batches of a fixed size: the trials depend on plan, picture and code only, and an
interrupted search goes on.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import optuna
from optuna.distributions import CategoricalDistribution, FloatDistribution
from optuna.samplers import TPESampler
from optuna.trial import TrialState

from bags.errors import BagError
from bags.evaluation.metrics import driving
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.evaluation.series import compute_series
from experiments.batch.distributions import Choice
from experiments.pool import Pool
from experiments.search_journal import open_journal
from experiments.settings import drive, measures
from experiments.settings import setting as settings
from experiments.settings.preregistration import Perturbation, Preregistration
from experiments.settings.setting import Rejected, Setting
from experiments.settings_analysis import picture as pictures
from experiments.settings_analysis.picture import Picture

JOURNAL, STUDY = 'picture.journal', 'picture'
RESULT, IDENTITY = 'result', 'identity'
UNDISTURBED = Perturbation(speed_mps=0.0, y_m=0.0)


class Candidate(NamedTuple):
    """A setting and how far it is from the picture."""

    number: int  # of the trial
    values: dict[str, Any]  # by dimension
    rejected: str  # why the point is no setting, or its drives failed; '' for none
    features: dict[str, float | None]  # {} when rejected
    missed: dict[str, float]  # shortfalls by item; {} when rejected
    distance: float


def judge(
    plan: Preregistration,
    picture: Picture,
    number: int,
    values: Mapping[str, Any],
    start: Perturbation = UNDISTURBED,
) -> Candidate:
    """Drive a point by the three controllers of the picture and return its distance."""
    built = settings.build(plan, number, values)
    if isinstance(built, Rejected):
        return _rejected(picture, number, values, built.reason)
    try:
        measured = [measure_drive(plan, built, name, start) for name in pictures.arms_of(picture)]
    except BagError as error:
        return _rejected(picture, number, values, str(error))
    known = dict(values) | {'plant_limit_mps2': built.plant.limit}
    features = pictures.features(*measured, known, picture.stations)
    missed = pictures.shortfalls(features, picture)
    return Candidate(number, dict(values), '', features, missed, pictures.distance(missed))


def _rejected(picture, number, values, reason):
    return Candidate(number, dict(values), reason, {}, {}, pictures.greatest_distance(picture))


def measure_drive(
    plan: Preregistration, setting: Setting, name: str, start: Perturbation
) -> dict[str, Any]:
    """Return a row of the study's table and the overshoots of one drive. Raises BagError."""
    task = drive.plan_drive(plan, setting, name)._replace(start=start)
    driven, columns = drive.simulate(task)
    conditions = plan.preconditions
    values = measures.measure(driven, columns, setting, conditions.P4)
    wide = driving.overshoots(EvaluatedDrive(driven, compute_series(driven)))
    return values | {pictures.OVERSHOOTS: [place['x_m'] for place in wide]}


def search(
    plan: Preregistration,
    picture: Picture,
    trials: int,
    folder: Path,
    pool: Pool,
    on_candidate: Callable[[Candidate], None],
    starts: Sequence[Mapping[str, Any]] = (),
) -> list[Candidate]:
    """Search, or go on with the search in `folder`; return every candidate in order.

    `starts` are values of settings that are tried first. Raises BagError when the folder holds the
    search of another plan or picture, or one in progress.
    """
    candidates = []
    with open_journal(folder / JOURNAL, optuna.logging.ERROR) as storage:
        study = _study(storage, plan, picture, starts)
        for candidate in _run(study, plan, picture, trials, pool):
            on_candidate(candidate)
            candidates.append(candidate)
    return candidates


def _study(storage, plan, picture, starts):
    study = optuna.create_study(storage=storage, study_name=STUDY, load_if_exists=True)
    identity = {'plan': plan.digest, 'picture': repr(picture)}
    if IDENTITY not in study.user_attrs:
        study.set_user_attr(IDENTITY, identity)
        for values in starts:
            study.enqueue_trial(to_cube(plan, values))
    if study.user_attrs[IDENTITY] != identity:
        raise BagError(
            'the search in this folder was made with other settings or another picture; move it '
            'away or name another folder'
        )
    return study


def cube(plan: Preregistration) -> dict[str, Any]:
    """Return optuna's distribution of every dimension: shares 0 to 1, or the index of a choice."""
    return {
        name: CategoricalDistribution(range(len(kind.values)))
        if isinstance(kind, Choice)
        else FloatDistribution(0.0, 1.0)
        for name, kind in plan.dimensions.items()
    }


def from_cube(plan: Preregistration, shares: Mapping[str, float]) -> dict[str, Any]:
    """Return the values of a point of the cube."""
    return {
        name: kind.values[int(shares[name])]
        if isinstance(kind, Choice)
        else kind.value(float(shares[name]))
        for name, kind in plan.dimensions.items()
    }


def to_cube(plan: Preregistration, values: Mapping[str, Any]) -> dict[str, float]:
    """Return the point of the cube that has these values, to one part in 2^40."""
    return {name: _share(kind, values[name]) for name, kind in plan.dimensions.items()}


def _share(kind, value):
    if isinstance(kind, Choice):
        return kind.values.index(value)
    # every distribution's value grows with its share
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if kind.value(middle) < value else (low, middle)
    return (low + high) / 2


def _run(study, plan, picture, trials, pool):
    """Yield the candidates in order, the stored ones first."""
    ranges, done = cube(plan), 0
    while done < trials:
        end = min(trials, (done // picture.search.batch + 1) * picture.search.batch)
        for number in range(len(_asked(study)), end):
            # seeded per trial: independent of the trials before an interruption
            study.sampler = _sampler(picture, number)
            study.ask(ranges)
        batch = _asked(study)[done:end]
        waiting = [trial for trial in batch if trial.state is TrialState.RUNNING]
        tasks = [(plan, picture, trial.number, from_cube(plan, trial.params)) for trial in waiting]
        for trial, candidate in zip(waiting, pool.run(judge, tasks, lambda: None)):
            handle = optuna.trial.Trial(study, trial._trial_id)
            handle.set_user_attr(RESULT, json.loads(json.dumps(candidate._asdict())))
            study.tell(handle, candidate.distance)
        for trial in _asked(study)[done:end]:
            yield Candidate(**trial.user_attrs[RESULT])
        done = end


def _asked(study):
    return study.get_trials(states=(TrialState.RUNNING, TrialState.COMPLETE))


def _sampler(picture, number):
    seed = np.random.SeedSequence((picture.search.seed, number)).generate_state(1)[0]
    return TPESampler(seed=int(seed), n_startup_trials=picture.search.random, multivariate=True)
