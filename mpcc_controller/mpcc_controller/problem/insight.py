"""A plan, looked at: its cost term by term, its distances, its use of the friction. SI units."""

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from mpcc_controller.model import single_track, tree
from mpcc_controller.model.single_track import Axles
from mpcc_controller.problem import ocp
from mpcc_controller.problem.ocp import Formula
from stage_solver.stage_problem import Plan


class View(NamedTuple):
    """One stage, looked at; the leaves of `Insight` before they are gathered over the stages."""

    terms: Any  # weighted squared errors, under the names of the weights
    v2o: tuple  # m, per obstacle slot, the nearest circle
    v2e: tuple  # m, left and right, the nearest circle
    priority_o: tuple  # q / P_k per obstacle slot
    priority_e: tuple  # q / P_k, left and right
    friction: Axles  # -, tyre force over mu Fz
    split_ideal: Any  # -
    tracking: Any  # the formulation's errors


class Insight:
    """Evaluates plans of one formulation."""

    def __init__(self, formula: Formula):
        flat, x, u, p = ocp.symbols(formula)
        self._view = _view(formula, x, u, p)
        self._of_input = tuple(formula.input_errors(x, u, p))
        outputs = ca.vertcat(*tree.leaves(self._view))
        self._evaluate = ca.Function('insight', list(flat), [outputs])

    def of(self, plan: Plan, P: np.ndarray) -> View:
        """Return a view whose leaves are arrays over the stages (N + 1,).

        The last stage has no input: the terms of the input are 0 there, and its friction is that
        of the stage before.
        """
        U = np.vstack((plan.U, plan.U[-1:]))
        view = tree.fill(self._view, self._evaluate(plan.X.T, U.T, P.T).full())
        for name in self._of_input:
            getattr(view.terms, name)[-1] = 0
        return view


def _view(formula, x, u, p) -> View:
    v2o, v2e = (tuple(_smallest(D) for D in group) for group in formula.distances(x, p))
    Fz = single_track.loads(x.Fx, p.car)
    F = single_track.tyre_forces(x, u, p.car)
    squared = ocp.errors(formula, x, u, p)
    return View(
        terms=type(p.weights)(**ocp.terms(squared, p.weights)),
        v2o=v2o,
        v2e=v2e,
        priority_o=tuple(formula.priority(D, p.D_sft.o) for D in v2o),
        priority_e=tuple(formula.priority(D, p.D_sft.e) for D in v2e),
        friction=Axles(
            f=ca.hypot(F.F_xf, F.F_yf) / (p.car.mu_f * Fz.f),
            r=ca.hypot(F.F_xr, F.F_yr) / (p.car.mu_r * Fz.r),
        ),
        split_ideal=single_track.ideal_split(x.Fx, p.car),
        tracking=formula.tracking(x, p),
    )


def _smallest(distances):
    least = distances[0]
    for D in distances[1:]:
        least = ca.fmin(least, D)
    return least
