"""Cost and residual of plans, computed from the stage functions, independent of any solver."""

import numpy as np

from stage_solver.stage_problem import Bounds, Plan, StageProblem


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
