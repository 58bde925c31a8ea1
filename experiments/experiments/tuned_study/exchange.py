"""Why both controllers differ in a task: the MPCC's ticks, solved again with parts exchanged.

The MPCC drives the task. The problem of each tick is then solved again, from the same state and
first guess, with one difference of the two formulations as the baseline has it, with all of them,
with the baseline's weights, and with both. What an exchange does to the plan is told by the planned
lateral position, `AHEAD_S` ahead.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from bags.errors import BagError
from experiments import drive_row, simulation
from experiments.replay.recorded_problem import Problem
from experiments.simulation import Setup
from experiments.tuned_study import arms
from experiments.tuned_study.arms import COMPARED
from mpcc_controller.driving.parts import Parts
from scenario_publisher.scenario import Scenario

WEIGHTS, ALL, BOTH = 'weights', 'all parts', 'all parts and weights'
AHEAD_S = 1.0


class Path(NamedTuple):
    """What a car drove, tick by tick; arrays are (ticks,), in the map."""

    X: np.ndarray  # m
    Y: np.ndarray  # m
    delta: np.ndarray  # rad, of the front wheels


class Exchange(NamedTuple):
    """One task that only one of both arms avoids."""

    replicate: int
    task: int
    avoids: str  # the arm that avoids
    scn: Scenario
    driven: Mapping[str, Path]  # by arm
    # (ticks,) m by exchange, at the ticks of the MPCC: planned lateral position AHEAD_S ahead, less
    # that of the plan without an exchange; NaN where either problem has no solution
    shifts: Mapping[str, np.ndarray]

    def sizes(self) -> dict[str, float]:
        """Return the root of the mean square of each shift [m]."""
        return {name: float(np.sqrt(np.nanmean(v**2))) for name, v in self.shifts.items()}


def choose(drives: pd.DataFrame, replicate: int) -> tuple[int, str]:
    """Return the first judged task of a replicate that one arm alone avoids, and which one.

    `drives` is the table of the study. Raises BagError where there is none.
    """
    rows = drives[drives['judged'] & drives['replicate'].eq(replicate) & drives['start'].eq(0)]
    avoided = rows.pivot(index='task', columns='arm', values='avoided')[[*COMPARED]].dropna()
    alone = avoided[avoided[COMPARED[0]] != avoided[COMPARED[1]]]
    if alone.empty:
        raise BagError(f'replicate {replicate}: both arms avoid the same tasks')
    task = alone.sort_index().iloc[0]
    return int(task.name), next(arm for arm in COMPARED if task[arm])


def explain(plan: Mapping[str, Any], tables: Mapping[str, pd.DataFrame], number: int) -> Exchange:
    """Drive the chosen task of a replicate by both arms, and solve its ticks with exchanges.

    `tables` are `drives` and `tuned` of the study. Raises BagError.
    """
    task, avoids = choose(tables['drives'], number)
    replicate = tables['tuned'][tables['tuned']['replicate'] == number].set_index('arm')
    tuned = {
        arm: {name: replicate.loc[arm, name] for name in arms.tuned_parameters(plan, arm)}
        for arm in COMPARED
    }
    seed = plan['seeds']['judged'] + number

    def setup(arm: str, chosen: Mapping[str, Any] | None = None) -> Setup:
        chosen = arms.settings(plan, arm, tuned) if chosen is None else chosen
        return drive_row.prepare(arms.row(plan, arm, chosen, seed, task))

    own = setup('mpcc')
    parts = dict(zip(plan['factors'], np.identity(len(plan['factors']), int).astype(str).tolist()))
    parts[ALL] = ['1'] * len(plan['factors'])
    arm_of = {name: arms.FACTORIAL + ''.join(digits) for name, digits in parts.items()}
    exchanged = {name: setup(arm) for name, arm in arm_of.items()}
    for name, arm in ((WEIGHTS, 'mpcc'), (BOTH, arm_of[ALL])):
        exchanged[name] = setup(arm, {**arms.settings(plan, arm, tuned), **tuned['frenet']})
    path, problems = drive(own)
    planned = {
        name: plan_ahead(problems, changed) for name, changed in {'': own, **exchanged}.items()
    }
    shifts = {name: planned[name] - planned[''] for name in exchanged}
    driven = {'mpcc': path, 'frenet': drive(setup('frenet'))[0]}
    return Exchange(number, task, avoids, own.scn, driven, shifts)


def drive(setup: Setup) -> tuple[Path, list[Problem | None]]:
    """Simulate until the drive ends or fails; return its path and the problem of every tick.

    A tick without one braked, or drove a plan of before.
    """
    places, problems, last = [], [], None
    for step in simulation.steps(setup):
        state, solved = step.car.state, step.controller.memory.solved
        places.append((state.X, state.Y, step.car.actuators.delta))
        problem = None
        if solved is not None and solved is not last:
            parts = step.controller.parts
            problem = Problem(parts, setup.vehicle, solved.problem, step.car.stamp_ns)
        problems.append(problem)
        last = solved
        if arms.has_failed(setup.scn, state):
            break
    return Path(*np.array(places).T), problems


def plan_ahead(problems: Sequence[Problem | None], setup: Setup) -> np.ndarray:
    """Return the planned lateral position [m] of each problem by the parameters of a setup."""
    parts = Parts(setup.params, setup.vehicle, False)
    stage = round(AHEAD_S / setup.params.model.step_s)
    values = np.full(len(problems), np.nan)
    for k, problem in enumerate(problems):
        solved = problem and problem.with_parts(parts).solve()
        if solved and solved.is_feasible:
            values[k] = solved.states['Y'][stage]
    return values
