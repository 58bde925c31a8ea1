"""What to do when the solver does not deliver: four rungs, each with the reason for taking it.

1 solved -> 2 stopped early, but good enough -> 3 the last plan, moved on -> 4 straight braking.
"""

from typing import NamedTuple

import numpy as np

from mpcc_controller.parameters import Fallback
from mpcc_controller.shooting import Plan
from mpcc_controller.solver import SOLVED, STOPPED_EARLY, Solution

SHIFTED = 'shifted'
BRAKING = 'braking'
REASONS = {SOLVED: 'converged', STOPPED_EARLY: 'good_enough'}


class Decision(NamedTuple):
    """Which rung is taken, with the plan to follow (None: brake)."""

    rung: str
    reason: str
    plan: Plan | None


class Ladder:
    """Remembers the last good plan, its age, and how often the solver failed in a row."""

    def __init__(self, rules: Fallback):
        self.rules = rules
        self.plan: Plan | None = None  # the last good one, as it was or moved on
        self.age = 0  # ticks since `plan` was solved
        self.failures = 0  # in a row

    @property
    def is_warm(self) -> bool:
        """Tell whether the next solve should start from `plan`."""
        return self.plan is not None and self.failures < self.rules.failures_to_cold_start

    def decide(self, solution: Solution, moved_on: Plan | None) -> Decision:
        """Return the rung for this solution; `moved_on` is the last plan as of this tick."""
        reason = fault(solution, self.rules)
        if not reason:
            self.plan, self.age, self.failures = solution.plan, 0, 0
            return Decision(solution.status, REASONS[solution.status], solution.plan)
        self.failures += 1
        return self.without_solution(reason, moved_on)

    def without_solution(self, reason: str, moved_on: Plan | None) -> Decision:
        """Return the rung when there is no usable solution."""
        self.age += 1
        if moved_on is None or self.age > self.rules.max_plan_age:
            return self.brake(reason)
        self.plan = moved_on
        return Decision(SHIFTED, reason, moved_on)

    def brake(self, reason: str) -> Decision:
        """Return the last rung, and forget the plan: the car no longer follows it."""
        self.plan, self.age = None, 0
        return Decision(BRAKING, reason, None)


def fault(solution: Solution, rules: Fallback) -> str:
    """Return why a solution must not be driven, or '' when it may."""
    if not (np.all(np.isfinite(solution.plan.X)) and np.all(np.isfinite(solution.plan.U))):
        return 'plan_not_finite'
    if solution.status == SOLVED:
        return ''
    if solution.status != STOPPED_EARLY:
        return 'solver_failed'
    # "not <=": a residual of NaN is a fault too
    return 'plan_not_feasible' if not solution.primal_residual <= rules.acceptable_residual else ''
