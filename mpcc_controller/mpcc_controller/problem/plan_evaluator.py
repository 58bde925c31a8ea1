"""Evaluates a plan: cost by term, distances, priorities, use of the friction. SI units."""

from functools import cache, lru_cache, reduce
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Axles
from mpcc_controller.problem import cost_terms, ocp
from mpcc_controller.problem.ocp import SymbolicOcp
from node_runtime import named_vector
from stage_solver.compiled_functions import BufferedFunction
from stage_solver.stage_problem import MAX_CACHED_PROBLEMS, Plan


class PlanValues(NamedTuple):
    """The values of a plan, each leaf over the stages (N + 1,)."""

    costs: Any  # weighted squared errors by the name of the term
    v2o: tuple  # m, per obstacle slot, the closest circle
    v2e: tuple  # m, left and right, the closest circle
    priority_o: tuple  # q / P_k per obstacle slot
    priority_e: tuple  # q / P_k, left and right
    friction: Axles  # -, tyre force over mu Fz
    tracking: Any  # the tracking errors of the formulation


class PlanEvaluator:
    """Evaluates plans of one formulation. Its functions are built at the first evaluation."""

    def __init__(self, symbolic: SymbolicOcp):
        self._symbolic = symbolic
        self._input_terms = tuple(term.name for term in symbolic.terms if term.uses_input)
        self._evaluators = cache(lambda count: BufferedFunction(_stage(symbolic)[1].map(count)))

    def evaluate(self, plan: Plan, P: np.ndarray) -> PlanValues:
        """Return the values of a plan in the states of the formulation, parameters P (N + 1, np).

        The last stage has no input: the terms of the input are 0 there, and its friction use is
        that with the input of the stage before.
        """
        U = np.vstack((plan.U, plan.U[-1:]))
        evaluate = self._evaluators(len(plan.X))
        numbers = evaluate(X=plan.X.ravel(), U=U.ravel(), P=P.ravel())['values']
        rows = numbers.reshape(len(plan.X), -1).T.copy()
        values = named_vector.build(_stage(self._symbolic)[0], rows)
        for name in self._input_terms:
            getattr(values.costs, name)[-1] = 0
        return values

    def cost(self, plan: Plan, P: np.ndarray) -> float:
        """Return the cost of a plan, that of its Solution where it was solved with P."""
        return float(np.sum(self.evaluate(plan, P).costs))


@lru_cache(MAX_CACHED_PROBLEMS)
def _stage(symbolic: SymbolicOcp) -> tuple[PlanValues, ca.Function]:
    """Return the values of one stage as expressions, and (X, U, P) -> the same, flat."""
    flat, x, u, p = ocp.symbols(symbolic)
    quantities = symbolic.quantities(x, u, p)
    errors = cost_terms.squared_errors(symbolic.terms, quantities)
    v2o, v2e = (
        tuple(reduce(ca.fmin, circles) for circles in group)
        for group in (quantities.v2o, quantities.v2e)
    )
    acting = single_track.acting(x, u, p.car)
    Fz = single_track.loads(acting.Fx, p.car)
    F = single_track.tyre_forces(acting, u, p.car)
    values = PlanValues(
        costs=type(p.weights)(**cost_terms.costs(errors, p.weights)),
        v2o=v2o,
        v2e=v2e,
        priority_o=tuple(quantities.priority(D, p.D_sft.o) for D in v2o),
        priority_e=tuple(quantities.priority(D, p.D_sft.e) for D in v2e),
        friction=Axles(
            f=ca.hypot(F.F_xf, F.F_yf) / (p.car.mu_f * Fz.f),
            r=ca.hypot(F.F_xr, F.F_yr) / (p.car.mu_r * Fz.r),
        ),
        tracking=quantities.tracking,
    )
    outputs = ca.vertcat(*named_vector.leaves(values))
    return values, ca.Function('evaluate', [*flat], [outputs], ['X', 'U', 'P'], ['values'])
