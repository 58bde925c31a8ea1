"""Correctness of answers: cost gap to IPOPT from the same start; other minima are identified."""

import hashlib
from collections import Counter
from typing import NamedTuple

import numpy as np
from interleaved_runs import Answer, Task
from plan_cost import PlanCost
from solver_variants import REFERENCE

from stage_solver.solution import SOLVED, SolverOptions
from stage_solver.solver import make_solver
from stage_solver.stage_problem import Plan, StageProblem

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

    def __init__(self, problem: StageProblem, reference: SolverOptions = REFERENCE):
        self.plan_cost = PlanCost(problem)
        self._reference = make_solver(problem, reference)
        self._minima: dict[bytes, tuple[Plan, float] | None] = {}

    def assess(self, task: Task, answer: Answer) -> Assessment:
        """Return the assessment of an answer to a task.

        GOOD: feasible, and the cost is that of the minimum which the reference finds from the same
        start. OTHER_MINIMUM: feasible, and the cost is that of the minimum which the reference
        finds from the answer, which is APART from the former. WORSE: feasible, none of these.
        """
        residual = self.plan_cost.residual(answer.plan, task.x0, task.P, task.bounds)
        if residual > MAX_RESIDUAL:
            return Assessment(INFEASIBLE, np.nan, residual)
        cost = self.plan_cost.cost(answer.plan, task.P)
        reference = self._minimum(task, task.start)
        gap = np.nan if reference is None else _gap(cost, reference[1])
        if abs(gap) <= MAX_GAP:
            return Assessment(GOOD, gap, residual)
        near = self._minimum(task, answer.plan)
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
            solution = self._reference.solve(*task.arguments[:-1], start)
            residual = self.plan_cost.residual(solution.plan, task.x0, task.P, task.bounds)
            minimum = None
            if solution.status == SOLVED and residual <= MAX_RESIDUAL:
                plan = Plan(solution.plan.X, solution.plan.U)
                minimum = plan, self.plan_cost.cost(plan, task.P)
            self._minima[key] = minimum
        return self._minima[key]


def success_rate(assessments: list[Assessment]) -> float:
    """Return the share of good answers; answers at other minima count neither way."""
    count = Counter(assessment.kind for assessment in assessments)
    counted = len(assessments) - count[OTHER_MINIMUM]
    return count[GOOD] / counted if counted else 1.0


def max_gap(assessments: list[Assessment]) -> float:
    """Return the largest cost gap of the feasible answers that are at no other minimum."""
    gaps = [v.gap for v in assessments if v.kind in (GOOD, WORSE) and np.isfinite(v.gap)]
    return max(gaps, default=0.0)


def _gap(cost, reference):
    return (cost - reference) / max(abs(reference), MIN_COST)
