"""One iteration per tick against converged plans: how much worse is the driving?

The cost of a drive is the sum of the stage costs of what was driven: state, input and numbers of
stage 0 at every tick.
"""

from typing import NamedTuple

import loops
import numpy as np
from loops import FULL, Loop
from rich.progress import Progress
from tables import Sheet, number
from variants import OWN, RealTimeIteration

from mpcc_controller.parameters import ControllerParams
from mpcc_controller.solvers import solver
from mpcc_controller.solvers.solver import SolverOptions


class Drive(NamedTuple):
    """What a drive cost."""

    cost: float  # sum of stage costs over the ticks that had a plan
    ticks: int
    unplanned: int  # ticks at which there was no plan to follow: the car braked


def measure(params: ControllerParams, progress: Progress) -> tuple[Sheet, list[dict]]:
    """Return a table and its figures, one row per loop; both empty without the own solver."""
    title = 'Closed loop: one iteration per tick against converged'
    columns = ('loop', 'converged', 'one step', 'difference', 'ticks', 'ticks without a plan')
    if OWN not in solver.SOLVERS:
        return Sheet(title, columns, [], f'There is no solver {OWN!r} in this version.'), []
    figures = []
    for loop in progress.track(FULL, description='driving with one step per tick'):
        base = loops.with_solver(loops.controller_params(loop.controller), OWN)
        converged, stepped = driven(loop, base), driven(loop, base, one_step=True)
        figures.append(
            {
                'loop': loop.name,
                'converged': converged._asdict(),
                'one_step': stepped._asdict(),
                'difference': stepped.cost / converged.cost - 1,
            }
        )
    return Sheet(title, columns, [row(one) for one in figures]), figures


def row(one: dict) -> tuple[str, ...]:
    """Return a line of the table."""
    converged, stepped = one['converged'], one['one_step']
    return (
        one['loop'],
        number(converged['cost']),
        number(stepped['cost']),
        f'{100 * one["difference"]:+.2f} %',
        f'{converged["ticks"]} / {stepped["ticks"]}',
        f'{converged["unplanned"]} / {stepped["unplanned"]}',
    )


def driven(loop: Loop, params: ControllerParams, one_step: bool = False) -> Drive:
    """Drive a whole loop, with converged plans or with one iteration per tick."""
    scn = loops.load_scenario(loop.scenario, loop.speed)
    controller = loops.make_controller(params, scn.friction)
    problem, rules = controller.horizon.problem, params.solver
    if one_step:
        options = SolverOptions(
            rules.name, rules.max_iterations, rules.tolerance, None, rules.compiled
        )
        controller.horizon.solver = RealTimeIteration(problem, options)
    costs = []
    for _ in loops.drive(scn, controller):
        plan, posed = controller.horizon.ladder.plan, controller.horizon.posed
        known = plan is not None
        costs.append(float(problem.stage_cost(plan.X[0], plan.U[0], P[0])) if known else np.nan)
    return Drive(float(np.nansum(costs)), len(costs), int(np.isnan(costs).sum()))
