"""One iteration per tick against converged plans: the closed loops of docs/solver.md.

`solver_comparison` prints it. The cost of a drive is the sum of the stage costs of what was driven:
state, input and numbers of stage 0 at every tick.
"""

from collections.abc import Callable, Iterable

import closed_loops
import numpy as np
from closed_loops import FULL, Loop, Noted
from tables import markdown, number

from mpcc_controller.parameters import ControllerParams

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
        base = closed_loops.controller_params(loop.controller)
        drives = {name: driven(loop, base, settings) for name, settings in SCHEMES.items()}
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


def driven(loop: Loop, params: ControllerParams, settings: dict) -> tuple[np.ndarray, ...]:
    """Drive a whole loop with our solver and settings of it.

    Returns the stage cost of every tick (NaN where there was no plan to follow: the car braked),
    the time of every solve between a state and its command [ms], whether it took more than one
    iteration, and the time of what was computed after each command [ms].
    """
    scn = closed_loops.load_scenario(loop.scenario, loop.speed)
    params = closed_loops.with_solver(params, **settings)
    controller = closed_loops.make_controller(params, scn.friction)
    parts = controller.parts
    noted = parts.solvers.followed = Noted(parts.solvers.followed)
    costs, prepared_s, iterations, seconds = [], [], [], []
    for _ in closed_loops.drive(scn, controller):
        plan, solved = controller.memory.plans.plan, controller.memory.solved
        stage_cost, cost = parts.model.problem.stage_cost, np.nan
        if plan is not None:
            cost = float(stage_cost(plan.X[0], plan.U[0], solved.problem.parameters.P[0]))
        costs.append(cost)
        iterations += noted.iterations
        seconds += noted.seconds
        prepared_s.append(controller.prepare())
        noted.forget()  # those of the preparation are counted separately
    ms, prepared_ms = 1e3 * np.array(seconds), 1e3 * np.array(prepared_s)
    return np.array(costs), ms, np.array(iterations) > 1, prepared_ms
