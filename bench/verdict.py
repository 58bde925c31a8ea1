"""Is an answer right? Cost gap to IPOPT from the same start; other local minima stand apart."""

import hashlib
from collections import Counter
from typing import NamedTuple

import numpy as np
from judge import Judge
from race import Answer, Task
from variants import REFERENCE

from stage_solver.solution import SOLVED, SolverOptions
from stage_solver.solver import make_solver
from stage_solver.stage_problem import Plan, StageProblem

LARGEST_GAP = 1e-4  # of the cost
LEAST_COST = 1e-2  # gaps are relative to this where the cost is lower: an error of 1/10 tolerance
LARGEST_RESIDUAL = 1e-4  # solver units
APART = 1e-2  # solver units (m, rad, kN, ...): minima that differ more are not the same

GOOD, OTHER_MINIMUM, DEARER, INFEASIBLE = 'good', 'other minimum', 'dearer', 'infeasible'


class Verdict(NamedTuple):
    """What an answer is worth."""

    kind: str
    gap: float  # relative, to the reference; nan where there is none or the plan is infeasible
    residual: float  # solver units


class Court:
    """Judges answers to one problem by those of a reference."""

    def __init__(self, problem: StageProblem, reference: SolverOptions = REFERENCE):
        self.judge = Judge(problem)
        self._reference = make_solver(problem, reference)
        self._known: dict[bytes, tuple[Plan, float] | None] = {}

    def verdict(self, task: Task, answer: Answer) -> Verdict:
        """Judge an answer to a task.

        GOOD: feasible, and the cost is that of the minimum which the reference finds from the same
        start. OTHER_MINIMUM: feasible, and the cost is that of the minimum which the reference
        finds from the answer, which is APART from the former. DEARER: feasible, neither of both.
        """
        residual = self.judge.residual(answer.plan, task.x0, task.P, task.bounds)
        if residual > LARGEST_RESIDUAL:
            return Verdict(INFEASIBLE, np.nan, residual)
        cost = self.judge.cost(answer.plan, task.P)
        reference = self._minimum(task, task.start)
        gap = np.nan if reference is None else _gap(cost, reference[1])
        if abs(gap) <= LARGEST_GAP:
            return Verdict(GOOD, gap, residual)
        near = self._minimum(task, answer.plan)
        if near is None or abs(_gap(cost, near[1])) > LARGEST_GAP:
            return Verdict(DEARER, gap, residual)
        if reference is None:
            return Verdict(GOOD, _gap(cost, near[1]), residual)
        is_apart = self.judge.distance(near[0], reference[0]) > APART
        return Verdict(OTHER_MINIMUM if is_apart else DEARER, gap, residual)

    def _minimum(self, task, start):
        """Return the reference's plan and its cost from a start, None where it finds none."""
        numbers = b''.join(array.tobytes() for array in (task.x0, task.P, start.X, start.U))
        key = hashlib.sha256(numbers).digest()
        if key not in self._known:
            solution = self._reference.solve(*task[1:-1], start)
            residual = self.judge.residual(solution.plan, task.x0, task.P, task.bounds)
            found = None
            if solution.status == SOLVED and residual <= LARGEST_RESIDUAL:
                plan = Plan(solution.plan.X, solution.plan.U)
                found = plan, self.judge.cost(plan, task.P)
            self._known[key] = found
        return self._known[key]


def success_rate(verdicts: list[Verdict]) -> float:
    """Return the share of good answers; answers at other minima count neither way."""
    count = Counter(verdict.kind for verdict in verdicts)
    judged = len(verdicts) - count[OTHER_MINIMUM]
    return count[GOOD] / judged if judged else 1.0


def max_gap(verdicts: list[Verdict]) -> float:
    """Return the largest cost gap of the feasible answers that are at no other minimum."""
    gaps = [v.gap for v in verdicts if v.kind in (GOOD, DEARER) and np.isfinite(v.gap)]
    return max(gaps, default=0.0)


def _gap(cost, reference):
    return (cost - reference) / max(abs(reference), LEAST_COST)
