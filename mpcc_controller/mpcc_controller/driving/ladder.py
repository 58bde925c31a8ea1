"""What to do when the solver does not deliver: five rungs, each with the reason for taking it.

1 solved -> 2 stopped early, but good enough -> 3 the second solver's plan -> 4 the last plan,
moved on -> 5 braking along the last good plan, or along the path.
"""

from typing import NamedTuple

import numpy as np

from mpcc_controller.parameters import Fallback
from stage_solver.solution import ONE_STEP, SOLVED, STOPPED_EARLY, Solution
from stage_solver.stage_problem import Plan

SECOND = 'second_solver'
SHIFTED = 'shifted'
BRAKING = 'braking'
# rung and reason of a solution that may be driven, by its status
FRESH = {
    SOLVED: (SOLVED, 'converged'),
    ONE_STEP: (SOLVED, 'one_step'),
    STOPPED_EARLY: (STOPPED_EARLY, 'good_enough'),
}


class Decision(NamedTuple):
    """Which rung is taken, with the plan to follow (None: brake)."""

    rung: str
    reason: str
    plan: Plan | None


class Ladder:
    """Remembers the last good plan, its age, and how often the solver failed in a row."""

    def __init__(self, rules: Fallback):
        self.rules = rules
        self.plan: Plan | None = None  # followed last, of this tick or moved on to it
        self.age = 0  # ticks since `plan` was solved
        self.failures = 0  # of the first solver, in a row
        self.good: Plan | None = None  # solved last, where it was solved
        self.good_age = 0  # ticks since then

    @property
    def is_warm(self) -> bool:
        """Tell whether the next solve should start from `plan`."""
        return self.plan is not None and self.failures < self.rules.failures_to_cold_start

    @property
    def guide(self) -> Plan | None:
        """The last good plan while it is young enough to steer along."""
        return self.good if self.good_age <= self.rules.max_guide_age else None

    def decide(
        self, solution: Solution, second: Solution | None, moved_on: Plan | None
    ) -> Decision:
        """Return the rung for this tick's solutions.

        `second` is that of the second solver where it was asked, `moved_on` the last plan as of
        this tick.
        """
        reason = fault(solution, self.rules)
        self.failures = self.failures + 1 if reason else 0
        if not reason:
            return self._fresh(*FRESH[solution.status], solution.plan)
        if second is not None and not fault(second, self.rules):
            return self._fresh(SECOND, reason, second.plan)
        return self.without_solution(reason, moved_on)

    def without_solution(self, reason: str, moved_on: Plan | None) -> Decision:
        """Return the rung when there is no usable solution."""
        if moved_on is None or self.age >= self.rules.max_plan_age:
            return self.brake(reason)
        self.plan = moved_on
        self.age += 1
        self.good_age += 1
        return Decision(SHIFTED, reason, moved_on)

    def brake(self, reason: str) -> Decision:
        """Return the last rung; from now on the car follows no plan, it only steers along one."""
        self.plan, self.age = None, 0
        self.good_age += 1
        return Decision(BRAKING, reason, None)

    def distrust(self) -> None:
        """Forget the plan altogether: the gate turned its command back."""
        self.plan = self.good = None
        self.age = 0

    def _fresh(self, rung, reason, plan):
        self.plan = self.good = plan
        self.age = self.good_age = 0
        return Decision(rung, reason, plan)


def fault(solution: Solution, rules: Fallback) -> str:
    """Return why a solution must not be driven, or '' when it may."""
    if not (np.all(np.isfinite(solution.plan.X)) and np.all(np.isfinite(solution.plan.U))):
        return 'plan_not_finite'
    if solution.status in (SOLVED, ONE_STEP):
        return ''
    if solution.status != STOPPED_EARLY:
        return 'solver_failed'
    # "not <=": a residual of NaN is a fault too
    return 'plan_not_feasible' if not solution.primal_residual <= rules.acceptable_residual else ''
