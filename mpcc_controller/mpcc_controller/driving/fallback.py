"""What to drive when the solver fails: five levels of fallback, each with its reason.

1 solved, 2 stopped early but acceptable, 3 the last plan shifted, 4 recovery of a car that slides,
if it is switched on (`recovery`), 5 braking along the last good plan or along the path (`braking`).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mpcc_controller.parameters import Fallback
from stage_solver.solution import ONE_STEP, SOLVED, STOPPED_EARLY, Solution
from stage_solver.stage_problem import Plan

SHIFTED = 'shifted'
RECOVERY = 'recovery'
BRAKING = 'braking'
# level and reason of a solution that may be driven, by its status
USABLE = {
    SOLVED: (SOLVED, 'converged'),
    ONE_STEP: (SOLVED, 'one_step'),
    STOPPED_EARLY: (STOPPED_EARLY, 'good_enough'),
}


class Decision(NamedTuple):
    """The level of fallback, its reason, and the plan to follow (None: recover or brake)."""

    level: str
    reason: str
    plan: Plan | None


def accept(plan: Plan) -> str:
    """Return no objection to a plan."""
    return ''


class FallbackLogic:
    """Remembers the last good plan, its age, and the failures of the solver in a row."""

    def __init__(self, params: Fallback):
        self.params = params
        self.plan: Plan | None = None  # followed last, of this tick or shifted to it
        self.plan_age = 0  # ticks since `plan` was solved
        self.failures = 0  # of the solver, in a row
        self._good_plan: Plan | None = None  # solved last, as solved
        self._good_plan_age = 0  # ticks since then

    @property
    def is_warm(self) -> bool:
        """Whether the next solve should start from `plan`."""
        return self.plan is not None and self.failures < self.params.failures_to_cold_start

    @property
    def guiding_plan(self) -> Plan | None:
        """The last good plan while it is recent enough to steer along."""
        return self._good_plan if self._good_plan_age <= self.params.max_guide_age else None

    def decide(
        self,
        solution: Solution,
        shifted: Plan | None,
        sliding: bool = False,
        objection: Callable[[Plan], str] = accept,
    ) -> Decision:
        """Return the decision for the solution of this tick; `shifted` is the last plan, moved on.

        A car that is `sliding` follows no old plan: it is not where that plan wanted it.
        Whatever plan is to be followed, the car brakes instead if there is an `objection` to it.
        """
        reason = rejection_reason(solution, self.params)
        self.failures = self.failures + 1 if reason else 0
        if not reason:
            return self._follow(*USABLE[solution.status], solution.plan, objection)
        if sliding:
            return self.brake(reason, sliding)
        return self.follow_shifted(reason, shifted, objection)

    def follow_shifted(
        self, reason: str, shifted: Plan | None, objection: Callable[[Plan], str] = accept
    ) -> Decision:
        """Return the decision without a usable solution: the shifted plan, or braking."""
        if shifted is None or self.plan_age >= self.params.max_plan_age:
            return self.brake(reason)
        objected = objection(shifted)
        if objected:
            return self.brake(objected)
        self.plan = shifted
        self.plan_age += 1
        self._good_plan_age += 1
        return Decision(SHIFTED, reason, shifted)

    def brake(self, reason: str, sliding: bool = False) -> Decision:
        """Return the decision to follow no plan, but perhaps to steer along the last good one.

        A car that is `sliding` is recovered, others are braked.
        """
        self.plan, self.plan_age = None, 0
        self._good_plan_age += 1
        return Decision(RECOVERY if sliding else BRAKING, reason, None)

    def discard_plan(self) -> None:
        """Drop every plan: the gate rejected a command of it."""
        self.plan = self._good_plan = None
        self.plan_age = 0

    def _follow(self, level, reason, plan, objection):
        objected = objection(plan)
        if objected:
            return self.brake(objected)
        self.plan = self._good_plan = plan
        self.plan_age = self._good_plan_age = 0
        return Decision(level, reason, plan)


def rejection_reason(solution: Solution, params: Fallback) -> str:
    """Return why a solution must not be driven, '' if it may."""
    if not (np.all(np.isfinite(solution.plan.X)) and np.all(np.isfinite(solution.plan.U))):
        return 'plan_not_finite'
    if solution.status in (SOLVED, ONE_STEP):
        return ''
    if solution.status != STOPPED_EARLY:
        return 'solver_failed'
    # "not <=" also rejects a residual of NaN
    feasible = solution.primal_residual <= params.acceptable_residual
    return '' if feasible else 'plan_not_feasible'
