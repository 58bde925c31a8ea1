"""Two stages of Bayesian optimisation with optuna: tree-structured Parzen estimators.

Optuna's ask-and-tell interface is used in batches of a fixed size, and every trial has a random
generator of its own, seeded by the plan. So the trials depend on plan and code only, not on the
number of processes, and an interrupted search continues with the same trials. The first trials of a
longer stage are those of a shorter one.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import optuna
from optuna.distributions import FloatDistribution
from optuna.samplers import TPESampler
from optuna.trial import TrialState

from bags.errors import BagError
from experiments.search_journal import open_journal
from experiments.tuning import problem
from experiments.tuning.problem import Condition, Score
from experiments.worker_pool import WorkerPool
from node_runtime import provenance

JOURNAL = 'trials.journal'
PLAN, SCORES, COMMIT = 'plan', 'scores', 'git_commit'
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
    pool: WorkerPool,
    on_run: Callable[[], None],
    on_trial: Callable[[Trial], None],
) -> list[Trial]:
    """Search, or continue the search of this plan in `folder`; return every trial in order.

    `on_run()` is called after each simulation, `on_trial(trial)` after each trial, stored ones
    first. Raises BagError when the folder holds a search of another plan, or one in progress.
    """
    trials: list[Trial] = []
    first = problem.untuned_weights(plan.controller)
    spans = problem.wide_spans(first)
    with open_journal(folder / JOURNAL) as storage:
        for stage in (1, 2):
            study = _study(storage, plan, stage, spans)
            if not study.trials:
                study.enqueue_trial({n: span.clip(first[n]) for n, span in spans.items()})
            for trial in _run_stage(study, plan, stage, spans, pool, on_run):
                on_trial(trial)
                trials.append(trial)
            first = find_best(trials).weights
            spans = problem.narrow_spans(spans, first)
    return trials


def read_commit(folder: Path) -> str:
    """Return the commit with which the search of a folder was begun, '' outside a repository."""
    with open_journal(folder / JOURNAL) as storage:
        return optuna.load_study(study_name=_name(1), storage=storage).user_attrs[COMMIT]


def find_best(trials: Sequence[Trial]) -> Trial:
    """Return the feasible trial of least cost; without one that of the least violation."""
    return min(trials, key=lambda trial: (sum(trial.violations), trial.cost))


def _study(storage, plan, stage, spans):
    study = optuna.create_study(
        storage=storage, study_name=_name(stage), direction='minimize', load_if_exists=True
    )
    # compared as read back from JSON; without `trials`, which may grow: the first ones stay equal
    identity = json.loads(json.dumps({**plan._replace(trials=None)._asdict(), 'spans': spans}))
    if PLAN not in study.user_attrs:
        study.set_user_attr(PLAN, identity)
        study.set_user_attr(COMMIT, provenance.commit())
    if study.user_attrs[PLAN] != identity:
        raise BagError(
            f'{plan.controller}: the search in this folder was begun with other settings or '
            'weights; move it away or name another folder'
        )
    return study


def _name(stage):
    return f'stage {stage}'


def _run_stage(study, plan, stage, spans, pool, on_run) -> Iterator[Trial]:
    """Yield the trials of a stage, the stored ones first."""
    ranges = {name: FloatDistribution(*span, log=True) for name, span in spans.items()}
    total = plan.trials[stage - 1]
    done = 0
    while done < total:
        end = min(total, (done // plan.batch + 1) * plan.batch)
        for number in range(len(_asked(study)), end):
            # seeded per trial: independent of the trials before an interruption
            study.sampler = _sampler(plan, stage, number)
            study.ask(ranges)
        batch = _asked(study)[done:end]
        waiting = [trial for trial in batch if trial.state is TrialState.RUNNING]
        _simulate(study, plan, waiting, pool, on_run)
        for trial in _asked(study)[done:end]:
            scores = tuple(Score(**score) for score in trial.user_attrs[SCORES])
            violations = problem.violations(scores, plan.tracking_m)
            yield Trial(stage, trial.number, _weights(trial), scores, violations)
        done = end


def _asked(study):
    return study.get_trials(states=(TrialState.RUNNING, TrialState.COMPLETE))


def _simulate(study, plan, trials, pool, on_run):
    """Simulate every trial under all conditions and tell the results, in their order."""
    tasks = [
        (plan.controller, _weights(trial), condition)
        for trial in trials
        for condition in plan.conditions
    ]
    scores = pool.run(problem.simulate, tasks, on_run)
    count = len(plan.conditions)
    for k, trial in enumerate(trials):
        own = scores[k * count : (k + 1) * count]
        handle = optuna.trial.Trial(study, trial._trial_id)
        handle.set_user_attr(SCORES, [score._asdict() for score in own])
        for name, value in zip(problem.CONSTRAINTS, problem.violations(own, plan.tracking_m)):
            # an interruption may have come between this and `tell`
            if name not in trial.constraints:
                handle.set_constraint(name, value)
        study.tell(handle, problem.cost(own))


def _weights(trial):
    """Return the simulated weights: rounded as in a tuned controller file."""
    return {name: float(f'{value:.{DIGITS}g}') for name, value in trial.params.items()}


def _sampler(plan, stage, number):
    seed = np.random.SeedSequence((plan.seed, stage, number)).generate_state(1)[0]
    return TPESampler(seed=int(seed), n_startup_trials=plan.random[stage - 1])


def as_rows(trials: Sequence[Trial]) -> list[Mapping[str, object]]:
    """Return the history as flat rows: stage, number, cost, safe, weights, scores by condition."""
    return [
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
    ]
