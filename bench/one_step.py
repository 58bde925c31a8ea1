"""One iteration per tick against converged plans: the closed loops of docs/solver.md.

`solver_comparison` prints it. The cost of a drive is the sum of the stage costs of what was driven:
state, input and numbers of stage 0 at every tick.
"""

from collections.abc import Callable, Iterable

import closed_loops
import numpy as np
from closed_loops import FULL
from tables import markdown, number

from experiments import simulation
from experiments.simulation import Setup

# whatever comes of the first step
ENDLESS = {'one_step_residual': 1.0, 'one_step_decrease': 1e3}
# the first one is what the others are compared with
SCHEMES = {
    'converged': {'mode': 'converged'},
    'one_step': {'mode': 'one_step'},
    'one_step_prepared': {'mode': 'one_step', 'prepare': True},
    'single_step': {'mode': 'one_step', **ENDLESS},
}


def table(track: Callable[..., Iterable]) -> str:
    """Return the drives of every loop in every scheme."""
    rows = []
    for loop in track(FULL, description='driving with one step per tick'):
        setup = closed_loops.make_setup(loop)
        drives = {name: driven(setup, settings) for name, settings in SCHEMES.items()}
        converged = np.nansum(drives['converged'][0])
        for name, (costs, ms, more, prepared_ms) in drives.items():
            cost = np.nansum(costs)
            row = [loop.name, name, number(cost), f'{100 * (cost / converged - 1):+.2f} %']
            row += [number(np.median(ms)), number(ms.max()), f'{100 * more.mean():.1f} %']
            row += [number(ms[more].mean() if more.any() else 0.0), number(np.median(prepared_ms))]
            rows.append([*row, len(costs), int(np.isnan(costs).sum())])
    columns = ('loop', 'scheme', 'cost', 'difference', 'median', 'max', 'iterations > 1')
    columns += ('their mean', 'after the command', 'ticks', 'without a plan')
    title = 'Closed loops: one step per tick against converged (ms from state to plan)'
    return markdown(title, columns, rows)


def driven(setup: Setup, settings: dict) -> tuple[np.ndarray, ...]:
    """Drive a whole loop with our solver and settings of it.

    Returns the stage cost of every tick (NaN where there was no plan to follow: the car braked),
    the time of every solve between a state and its command [ms], whether it took more than one
    iteration, and the time of what was computed before each state [ms].
    """
    setup = setup._replace(params=closed_loops.with_solver(setup.params, **settings))
    costs, prepared_s, solutions = [], [], []
    for step in simulation.steps(setup):
        memory, model = step.controller.memory, step.controller.parts.model
        plan, cost = memory.plans.plan, np.nan
        if plan is not None:
            P = memory.solved.problem.parameters.P
            cost = float(model.problem.stage_cost(plan.X[0], plan.U[0], P[0]))
        costs.append(cost)
        solutions += [step.record.attempt.solution] if step.record.attempt else []
        prepared_s.append(step.record.prepared_s or 0.0)
    ms, prepared_ms = 1e3 * np.array([s.solve_s for s in solutions]), 1e3 * np.array(prepared_s)
    return np.array(costs), ms, np.array([s.iterations for s in solutions]) > 1, prepared_ms
