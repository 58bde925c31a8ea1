"""Two stages of Bayesian optimisation with optuna: tree-structured Parzen estimators.

Trials are asked for and told in batches of a fixed size, and every trial has a random generator of
its own whose seed follows from the plan: the trials depend on plan and code only, not on the number
of processes, and a search that was interrupted goes on as if it had not been. The first trials of a
longer stage are those of a shorter one.
"""

import fcntl
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import optuna
from optuna.distributions import FloatDistribution
from optuna.samplers import TPESampler
from optuna.storages import BaseStorage, JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import TrialState

from bags.errors import BagError
from experiments.tuning import objective, space, tuned_file
from experiments.tuning.objective import Condition, Score
from experiments.worker_pool import WorkerPool
from node_runtime import provenance

JOURNAL = 'trials.journal'
PLAN, SCORES, COMMIT = 'plan', 'scores', 'git_commit'


class Plan(NamedTuple):
    """All that decides a search, apart from the code."""

    controller: str
    seed: int
    trials: tuple[int, int]  # of each stage, that which begins it included
    random: tuple[int, int]  # of them, drawn at random before there is anything to learn from
    batch: int  # trials asked for before any of them is told
    conditions: tuple[Condition, ...]
    tracking_m: float  # rms distance from the coarse path that is allowed


class Trial(NamedTuple):
    """One set of weights, and what its drives came to."""

    stage: int
    number: int  # within the stage; 0 is the untuned one, or the best of stage 1
    weights: dict[str, float]  # by dotted name
    scores: tuple[Score, ...]  # one per condition
    violations: tuple[float, ...]  # of objective.CONSTRAINTS

    @property
    def cost(self) -> float:
        """The objective."""
        return objective.cost(self.scores)

    @property
    def safe(self) -> bool:
        """Whether every drive kept all distances, reached its end and tracked the path."""
        return max(self.violations) <= 0.0


def run(
    plan: Plan,
    folder: Path,
    pool: WorkerPool,
    on_drive: Callable[[], None],
    on_trial: Callable[[Trial], None],
) -> list[Trial]:
    """Search, or go on with the search of this plan in `folder`; return every trial in order.

    `on_drive()` follows each drive, `on_trial(trial)` each trial, those of an earlier call first.
    Raises BagError when the folder holds a search of another plan, or one that is under way.
    """
    found: list[Trial] = []
    spans = space.wide(space.untuned(plan.controller))
    with _journal(folder) as storage:
        first = space.untuned(plan.controller)
        for stage in (1, 2):
            study = _study(storage, plan, stage, spans)
            if not study.trials:
                study.enqueue_trial({n: span.clipped(first[n]) for n, span in spans.items()})
            for trial in _stage(study, plan, stage, spans, pool, on_drive):
                on_trial(trial)
                found.append(trial)
            first = best(found).weights
            spans = space.narrow(spans, first)
    return found


def commit(folder: Path) -> str:
    """Return the commit with which the search in a folder was begun, '' outside of a repository."""
    with _journal(folder) as storage:
        return optuna.load_study(study_name=_name(1), storage=storage).user_attrs[COMMIT]


def best(trials: Sequence[Trial]) -> Trial:
    """Return the safe trial of least cost; without one that which violates least."""

    def rank(trial):
        return sum(trial.violations), trial.cost

    return min(trials, key=rank)


@contextmanager
def _journal(folder: Path) -> Iterator[BaseStorage]:
    """Yield the storage of a folder, which nobody else uses meanwhile."""
    folder.mkdir(parents=True, exist_ok=True)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    path = folder / JOURNAL
    with path.open('ab') as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BagError(f'{path}: another search is writing this file') from None
        yield JournalStorage(JournalFileBackend(str(path)))


def _study(storage, plan, stage, spans):
    study = optuna.create_study(
        storage=storage, study_name=_name(stage), direction='minimize', load_if_exists=True
    )
    # as JSON reads it back; a search may go on for longer, its first trials stay the same
    wanted = json.loads(json.dumps({**plan._replace(trials=None)._asdict(), 'spans': spans}))
    if PLAN not in study.user_attrs:
        study.set_user_attr(PLAN, wanted)
        study.set_user_attr(COMMIT, provenance.commit())
    if study.user_attrs[PLAN] != wanted:
        raise BagError(
            f'{plan.controller}: the search that lies here was made with other settings or weights '
            'than those asked for; move it away or name another folder'
        )
    return study


def _name(stage):
    return f'stage {stage}'


def _stage(study, plan, stage, spans, pool, on_drive) -> Iterator[Trial]:
    """Yield the trials of a stage, those that are known first."""
    ranges = {name: FloatDistribution(*span, log=True) for name, span in spans.items()}
    total = plan.trials[stage - 1]
    told = 0
    while told < total:
        end = min(total, (told // plan.batch + 1) * plan.batch)
        for number in range(len(_asked(study)), end):
            # a generator of its own: nothing depends on what was asked before an interruption
            study.sampler = _sampler(plan, stage, number)
            study.ask(ranges)
        batch = _asked(study)[told:end]
        waiting = [trial for trial in batch if trial.state is TrialState.RUNNING]
        _drive(study, plan, waiting, pool, on_drive)
        for trial in _asked(study)[told:end]:
            scores = tuple(Score(**score) for score in trial.user_attrs[SCORES])
            violations = objective.violations(scores, plan.tracking_m)
            yield Trial(stage, trial.number, _weights(trial), scores, violations)
        told = end


def _asked(study):
    return study.get_trials(states=(TrialState.RUNNING, TrialState.COMPLETE))


def _drive(study, plan, trials, pool, on_drive):
    """Drive every trial under all conditions and tell what came out, in their order."""
    tasks = [
        (plan.controller, _weights(trial), condition)
        for trial in trials
        for condition in plan.conditions
    ]
    scores = pool.run(objective.drive, tasks, on_drive)
    count = len(plan.conditions)
    for k, trial in enumerate(trials):
        own = scores[k * count : (k + 1) * count]
        handle = optuna.trial.Trial(study, trial._trial_id)
        handle.set_user_attr(SCORES, [score._asdict() for score in own])
        for name, value in zip(objective.CONSTRAINTS, objective.violations(own, plan.tracking_m)):
            # an interruption may have come between this and telling
            if name not in trial.constraints:
                handle.set_constraint(name, value)
        study.tell(handle, objective.cost(own))


def _weights(trial):
    """Return the weights that are driven: those that a file would hold."""
    return {name: tuned_file.rounded(value) for name, value in trial.params.items()}


def _sampler(plan, stage, number):
    seed = np.random.SeedSequence((plan.seed, stage, number)).generate_state(1)[0]
    return TPESampler(seed=int(seed), n_startup_trials=plan.random[stage - 1])


def drives_of(plan: Plan) -> int:
    """Return how many drives a plan takes."""
    return sum(plan.trials) * len(plan.conditions)


def as_rows(trials: Sequence[Trial]) -> list[Mapping[str, object]]:
    """Return the history as flat rows: stage, number, cost, safe, weights, scores by condition."""
    return [
        {
            'stage': trial.stage,
            'trial': trial.number,
            'cost': trial.cost,
            'safe': trial.safe,
            **trial.weights,
            **{
                f'{name}.{k + 1}': value
                for k, score in enumerate(trial.scores)
                for name, value in score._asdict().items()
            },
        }
        for trial in trials
    ]
