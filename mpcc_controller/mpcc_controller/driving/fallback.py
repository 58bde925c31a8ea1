"""What to drive when the solver fails: five levels of fallback, each with its reason.

1 solved, 2 stopped early but acceptable, 3 the last plan shifted, of a car that does not slide,
4 recovery of one that does, if it is switched on (`recovery`), 5 braking along the last good plan
or along the path (`braking`). Ticks that do not solve: `tick`.
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


class Plans(NamedTuple):
    """The plan that is followed, the last good one, and the failures of the solver in a row."""

    plan: Plan | None = None  # followed last, of this tick or shifted to it
    age: int = 0  # ticks since `plan` was solved
    failures: int = 0
    good: Plan | None = None  # solved last, as solved
    good_age: int = 0  # ticks since then

    def is_warm(self, params: Fallback) -> bool:
        """Return whether the next solve should start from `plan`."""
        return self.plan is not None and self.failures < params.failures_to_cold_start

    def guide(self, params: Fallback) -> Plan | None:
        """Return the last good plan while it is recent enough to steer along."""
        return self.good if self.good_age <= params.max_guide_age else None

    def decide(
        self,
        params: Fallback,
        solution: Solution,
        shifted: Plan | None,
        sliding: bool = False,
        objection: Callable[[Plan], str] = lambda plan: '',
    ) -> tuple['Plans', Decision]:
        """Return the decision for the solution of this tick; `shifted` is the last plan, moved on.

        A car that is `sliding` follows no old plan: it is not where that plan wanted it.
        Whatever plan is to be followed, the car brakes instead if there is an `objection` to it.
        """
        reason = rejection_reason(solution, params)
        now = self._replace(failures=self.failures + 1 if reason else 0)
        if reason and sliding:
            return now.brake(reason, sliding)
        if reason:
            return now.follow_shifted(params, reason, shifted, objection)
        objected = objection(solution.plan)
        if objected:
            return now.brake(objected)
        followed = Plans(solution.plan, good=solution.plan)
        return followed, Decision(*USABLE[solution.status], solution.plan)

    def follow_shifted(
        self,
        params: Fallback,
        reason: str,
        shifted: Plan | None,
        objection: Callable[[Plan], str] = lambda plan: '',
    ) -> tuple['Plans', Decision]:
        """Return the decision without a usable solution: the shifted plan, or braking."""
        if shifted is None or self.age >= params.max_plan_age:
            return self.brake(reason)
        objected = objection(shifted)
        if objected:
            return self.brake(objected)
        older = Plans(shifted, self.age + 1, self.failures, self.good, self.good_age + 1)
        return older, Decision(SHIFTED, reason, shifted)

    def brake(self, reason: str, sliding: bool = False) -> tuple['Plans', Decision]:
        """Return the decision to follow no plan, but perhaps to steer along the last good one.

        A car that is `sliding` is recovered, others are braked.
        """
        none = self._replace(plan=None, age=0, good_age=self.good_age + 1)
        return none, Decision(RECOVERY if sliding else BRAKING, reason, None)

    def discard(self) -> 'Plans':
        """Return what is left without every plan: the gate rejected a command of it."""
        return self._replace(plan=None, age=0, good=None)


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
