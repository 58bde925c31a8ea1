"""Cost and residual of plans from the stage functions, and how good answers are.

An answer is compared with what IPOPT finds from the same start; other minima are identified.
"""

import hashlib
from typing import NamedTuple

import numpy as np
from problems import Task

from stage_solver.reference_solvers import ReferenceSolver
from stage_solver.solution import SOLVED, SolverOptions
from stage_solver.stage_problem import Plan, StageProblem

REFERENCE = SolverOptions(max_iterations=1000, tolerance=1e-8)  # of every cost gap

MAX_GAP = 1e-4  # of the cost
MIN_COST = 1e-2  # gaps are relative to this where the cost is lower
MAX_RESIDUAL = 1e-4  # solver units
APART = 1e-2  # solver units (m, rad, kN, ...): minima that differ more are not the same

GOOD, OTHER_MINIMUM, WORSE, INFEASIBLE = 'good', 'other minimum', 'worse', 'infeasible'


class Assessment(NamedTuple):
    """The quality of one answer."""

    kind: str
    gap: float  # relative, to the reference; nan where there is none or the plan is infeasible
    residual: float  # solver units


class Assessor:
    """Compares answers to one problem with those of a reference solver."""

    def __init__(self, problem: StageProblem):
        self.problem = problem
        functions = problem.stage_cost, problem.dynamics, problem.constraints
        self._stages = [function.map(problem.horizon) for function in functions]
        self._reference = ReferenceSolver(problem, 'ipopt', REFERENCE, compiled=True)
        self._minima: dict[bytes, tuple[Plan, float] | None] = {}

    def assess(self, task: Task, plan: Plan) -> Assessment:
        """Return the assessment of a plan that answers a task.

        GOOD: feasible, and the cost is that of the minimum which the reference finds from the same
        start. OTHER_MINIMUM: feasible, and the cost is that of the minimum which the reference
        finds from that plan, which is APART from the former. WORSE: feasible, none of these.
        """
        cost, residual = self.evaluate(task, plan)
        if residual > MAX_RESIDUAL:
            return Assessment(INFEASIBLE, np.nan, residual)
        reference = self._minimum(task, task.start)
        gap = np.nan if reference is None else _gap(cost, reference[1])
        if abs(gap) <= MAX_GAP:
            return Assessment(GOOD, gap, residual)
        near = self._minimum(task, plan)
        if near is None or abs(_gap(cost, near[1])) > MAX_GAP:
            return Assessment(WORSE, gap, residual)
        if reference is None:
            return Assessment(GOOD, _gap(cost, near[1]), residual)
        apart = np.max(np.abs(near[0].X - reference[0].X) / self.problem.scale_x)
        return Assessment(OTHER_MINIMUM if apart > APART else WORSE, gap, residual)

    def evaluate(self, task: Task, plan: Plan) -> tuple[float, float]:
        """Return cost and residual of a plan that answers a task.

        The residual is the largest violation of start, dynamics, bounds or constraints in solver
        units; that of a plan that is not finite is inf.
        """
        (X, U, _), P, bounds, problem = plan, task.P, task.bounds, self.problem
        scale_x = np.array(problem.scale_x)
        costs, X_next, g = (f(X[:-1].T, U.T, P[:-1].T).full().T for f in self._stages)
        h = problem.terminal_constraints(X[-1], P[-1]).full().ravel()
        limited = (
            (X[0] / scale_x, task.x0 / scale_x, task.x0 / scale_x),
            (X[1:] / scale_x, X_next / scale_x, X_next / scale_x),
            (X[1:] / scale_x, bounds.x_low[1:] / scale_x, bounds.x_high[1:] / scale_x),
            (U / problem.scale_u, bounds.u_low / problem.scale_u, bounds.u_high / problem.scale_u),
            (g, bounds.g_low, bounds.g_high),
            (h, bounds.h_low, bounds.h_high),
        )
        violations = (np.maximum(low - x, x - high) for x, low, high in limited)
        # numpy's maximum propagates NaN, Python's does not
        largest = float(np.max([np.max(v, initial=0.0) for v in violations]))
        cost = float(costs.sum() + problem.terminal_cost(X[-1], P[-1]))
        return cost, largest if np.isfinite(largest) else np.inf

    def _minimum(self, task, start):
        """Return the reference's plan and its cost from a start, None where it fails."""
        content = b''.join(array.tobytes() for array in (task.x0, task.P, start.X, start.U))
        key = hashlib.sha256(content).digest()
        if key not in self._minima:
            solution = self._reference.solve(*task[1:-1], start)
            cost, residual = self.evaluate(task, solution.plan)
            is_minimum = solution.status == SOLVED and residual <= MAX_RESIDUAL
            self._minima[key] = (solution.plan, cost) if is_minimum else None
        return self._minima[key]


def _gap(cost, reference):
    return (cost - reference) / max(abs(reference), MIN_COST)
