"""Cost and residual of plans from the stage functions, and how good answers are.

An answer is compared with what IPOPT finds from the same start; other minima are identified.
"""

import hashlib
from typing import NamedTuple

import numpy as np
from problems import Task

from stage_solver.reference_solvers import ReferenceSolver
from stage_solver.solution import SOLVED, SolverOptions
from stage_solver.stage_problem import Bounds, Plan, StageProblem

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


class PlanCost:
    """Evaluates plans of one problem; residuals and distances are in its solver units."""

    def __init__(self, problem: StageProblem):
        self.problem = problem
        self.scale_x, self.scale_u = np.array(problem.scale_x), np.array(problem.scale_u)
        self._stage_cost = problem.stage_cost.map(problem.horizon)
        self._dynamics = problem.dynamics.map(problem.horizon)
        self._constraints = problem.constraints.map(problem.horizon)

    def cost(self, plan: Plan, P: np.ndarray) -> float:
        """Return the cost of a plan under stage parameters P (N + 1, np)."""
        before_last = self._stage_cost(plan.X[:-1].T, plan.U.T, P[:-1].T).full()
        return float(before_last.sum() + self.problem.terminal_cost(plan.X[-1], P[-1]))

    def residual(self, plan: Plan, x0: np.ndarray, P: np.ndarray, bounds: Bounds) -> float:
        """Return the largest violation of start, dynamics, bounds or constraints, solver units.

        A plan that is not finite has the residual inf.
        """
        X, U = plan.X, plan.U
        predicted = self._dynamics(X[:-1].T, U.T, P[:-1].T).full().T
        g = self._constraints(X[:-1].T, U.T, P[:-1].T).full().T
        h = self.problem.terminal_constraints(X[-1], P[-1]).full().ravel()
        violations = (
            np.abs(X[0] - x0) / self.scale_x,
            np.abs(X[1:] - predicted) / self.scale_x,
            _violation(X[1:], bounds.x_low[1:], bounds.x_high[1:]) / self.scale_x,
            _violation(U, bounds.u_low, bounds.u_high) / self.scale_u,
            _violation(g, bounds.g_low, bounds.g_high),
            _violation(h, bounds.h_low, bounds.h_high),
        )
        # numpy's maximum propagates NaN, Python's does not
        largest = float(np.max([np.max(v, initial=0.0) for v in violations]))
        return largest if np.isfinite(largest) else np.inf

    def distance(self, one: Plan, other: Plan) -> float:
        """Return the largest difference of a state between two plans, solver units."""
        return float(np.max(np.abs(one.X - other.X) / self.scale_x))


def _violation(values, low, high):
    return np.maximum(low - values, values - high)


class Assessor:
    """Compares answers to one problem with those of a reference solver."""

    def __init__(self, problem: StageProblem):
        self.plan_cost = PlanCost(problem)
        self._reference = ReferenceSolver(problem, 'ipopt', REFERENCE, compiled=True)
        self._minima: dict[bytes, tuple[Plan, float] | None] = {}

    def assess(self, task: Task, plan: Plan) -> Assessment:
        """Return the assessment of a plan that answers a task.

        GOOD: feasible, and the cost is that of the minimum which the reference finds from the same
        start. OTHER_MINIMUM: feasible, and the cost is that of the minimum which the reference
        finds from that plan, which is APART from the former. WORSE: feasible, none of these.
        """
        residual = self.plan_cost.residual(plan, task.x0, task.P, task.bounds)
        if residual > MAX_RESIDUAL:
            return Assessment(INFEASIBLE, np.nan, residual)
        cost = self.plan_cost.cost(plan, task.P)
        reference = self._minimum(task, task.start)
        gap = np.nan if reference is None else _gap(cost, reference[1])
        if abs(gap) <= MAX_GAP:
            return Assessment(GOOD, gap, residual)
        near = self._minimum(task, plan)
        if near is None or abs(_gap(cost, near[1])) > MAX_GAP:
            return Assessment(WORSE, gap, residual)
        if reference is None:
            return Assessment(GOOD, _gap(cost, near[1]), residual)
        is_apart = self.plan_cost.distance(near[0], reference[0]) > APART
        return Assessment(OTHER_MINIMUM if is_apart else WORSE, gap, residual)

    def _minimum(self, task, start):
        """Return the reference's plan and its cost from a start, None where it fails."""
        content = b''.join(array.tobytes() for array in (task.x0, task.P, start.X, start.U))
        key = hashlib.sha256(content).digest()
        if key not in self._minima:
            solution = self._reference.solve(*task[1:-1], start)
            residual = self.plan_cost.residual(solution.plan, task.x0, task.P, task.bounds)
            minimum = None
            if solution.status == SOLVED and residual <= MAX_RESIDUAL:
                plan = Plan(solution.plan.X, solution.plan.U)
                minimum = plan, self.plan_cost.cost(plan, task.P)
            self._minima[key] = minimum
        return self._minima[key]


def _gap(cost, reference):
    return (cost - reference) / max(abs(reference), MIN_COST)
