"""One iteration per tick against converged plans: how much worse is the driving, how fast?

The cost of a drive is the sum of the stage costs of what was driven: state, input and numbers of
stage 0 at every tick.
"""

import time
from typing import NamedTuple

import closed_loops
import numpy as np
import solver_variants
from closed_loops import FULL, Loop
from rich.progress import Progress
from tables import TextTable, number

from mpcc_controller.parameters import ControllerParams
from stage_solver.solution import Solution, StageSolver
from stage_solver.stage_problem import Bounds, Plan

ENDLESS = {'one_step_residual': 1.0, 'one_step_decrease': 1e3}  # whatever comes of the first step
# scheme -> (mode, other settings); the first one is what the others are compared with
SCHEMES = {
    'converged': ('converged', {}),
    'one_step': ('one_step', {}),
    'one_step_prepared': ('one_step', {'prepare': True}),
    'single_step': ('one_step', ENDLESS),
}


class Drive(NamedTuple):
    """What a drive cost, and how long the solver took between a state and its command."""

    cost: float  # sum of stage costs over the ticks that had a plan
    ticks: int
    unplanned: int  # ticks at which there was no plan to follow: the car braked
    median_ms: float
    max_ms: float
    prepare_ms: float  # median of what was computed after the command
    more_share: float  # of the solves: more than one iteration
    more_ms: float  # mean time of those


class Timed:
    """A StageSolver that notes its iterations and times."""

    def __init__(self, inner: StageSolver):
        self.inner = inner
        self.iterations, self.seconds = [], []

    def solve(self, x0: np.ndarray, P: np.ndarray, bounds: Bounds, guess: Plan) -> Solution:
        """See `solution.StageSolver`."""
        began = time.perf_counter()
        found = self.inner.solve(x0, P, bounds, guess)
        self.seconds.append(time.perf_counter() - began)
        self.iterations.append(found.iterations)
        return found


def measure(params: ControllerParams, progress: Progress) -> tuple[TextTable, list[dict]]:
    """Return a table and its figures, one per loop."""
    title = 'Closed loops: one step per tick against converged (ms from state to plan)'
    columns = ('loop', 'scheme', 'cost', 'difference', 'median', 'max', 'iterations > 1')
    columns += ('their mean', 'after the command', 'ticks', 'without a plan')
    figures = []
    for loop in progress.track(FULL, description='driving with one step per tick'):
        base = closed_loops.controller_params(loop.controller)
        drives = {name: driven(loop, base, *scheme) for name, scheme in SCHEMES.items()}
        converged = drives['converged'].cost
        figures.append(
            {
                'loop': loop.name,
                **{name: one._asdict() for name, one in drives.items()},
                'difference': drives['one_step'].cost / converged - 1,
                'differences': {name: one.cost / converged - 1 for name, one in drives.items()},
            }
        )
    return TextTable(title, columns, [row for one in figures for row in rows(one)]), figures


def rows(one: dict) -> list[tuple[str, ...]]:
    """Return the lines of a loop."""
    return [
        (
            one['loop'],
            name,
            number(one[name]['cost']),
            f'{100 * one["differences"][name]:+.2f} %',
            number(one[name]['median_ms']),
            number(one[name]['max_ms']),
            f'{100 * one[name]["more_share"]:.1f} %',
            number(one[name]['more_ms']),
            number(one[name]['prepare_ms']),
            str(one[name]['ticks']),
            str(one[name]['unplanned']),
        )
        for name in SCHEMES
    ]


def driven(loop: Loop, params: ControllerParams, mode: str, settings: dict) -> Drive:
    """Drive a whole loop in a mode of our solver, with other settings of it."""
    scn = closed_loops.load_scenario(loop.scenario, loop.speed)
    controller = closed_loops.make_controller(
        solver_variants.with_mode(params, mode, **settings), scn.friction
    )
    planner = controller.planner
    timed, costs, prepared_s = Timed(planner.solvers.first), [], []
    iterations, seconds = [], []
    planner.solvers.first = timed
    for _ in closed_loops.drive(scn, controller):
        plan, posed = planner.fallback.plan, planner.last_problem
        known = plan is not None
        P = posed.parameters.P[0] if known else None
        stage_cost = planner.prediction.problem.stage_cost
        cost = float(stage_cost(plan.X[0], plan.U[0], P)) if known else np.nan
        costs.append(cost)
        iterations += timed.iterations
        seconds += timed.seconds
        prepared_s.append(controller.prepare())
        timed.iterations, timed.seconds = [], []  # those of the preparation are counted separately
    more, ms = np.array(iterations) > 1, 1e3 * np.array(seconds)
    return Drive(
        cost=float(np.nansum(costs)),
        ticks=len(costs),
        unplanned=int(np.isnan(costs).sum()),
        median_ms=float(np.median(ms)),
        max_ms=float(ms.max()),
        prepare_ms=1e3 * float(np.median(prepared_s)),
        more_share=float(more.mean()),
        more_ms=float(ms[more].mean()) if more.any() else 0.0,
    )
