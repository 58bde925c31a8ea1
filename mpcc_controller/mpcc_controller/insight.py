"""A plan, looked at: its cost term by term, its distances, its use of the friction. SI units."""

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from mpcc_controller import arc, distance, mpcc_ocp, single_track, tree
from mpcc_controller.mpcc_ocp import STATE_TERMS, Stage, Weights
from mpcc_controller.shooting import Plan
from mpcc_controller.single_track import Axles, Input, State


class View(NamedTuple):
    """One stage, looked at; the leaves of `Insight` before they are gathered over the stages."""

    terms: Weights  # weighted squared errors
    v2o: tuple  # m, per obstacle slot, the nearest circle
    v2e: tuple  # m, left and right, the nearest circle
    priority_o: tuple  # q / P_k per obstacle slot
    priority_e: tuple  # q / P_k, left and right
    friction: Axles  # -, tyre force over mu Fz
    split_ideal: Any  # -
    con: Any  # m
    lag: Any  # m


class Insight:
    """Evaluates plans of one problem."""

    def __init__(self, shape: Stage):
        xs, us = ca.SX.sym('x', len(State._fields)), ca.SX.sym('u', len(Input._fields))
        ps = ca.SX.sym('p', len(tree.leaves(shape)))
        x, u = State(*ca.vertsplit(xs)), Input(*ca.vertsplit(us))
        self._view = _view(x, u, tree.fill(shape, ca.vertsplit(ps)))
        outputs = ca.vertcat(*tree.leaves(self._view))
        self._evaluate = ca.Function('insight', [xs, us, ps], [outputs])

    def of(self, plan: Plan, P: np.ndarray) -> View:
        """Return a view whose leaves are arrays over the stages (N + 1,).

        The last stage has no input: the terms of the input are 0 there, and its friction is that
        of the stage before.
        """
        U = np.vstack((plan.U, plan.U[-1:]))
        view = tree.fill(self._view, self._evaluate(plan.X.T, U.T, P.T).full())
        for name in set(Weights._fields) - set(STATE_TERMS):
            getattr(view.terms, name)[-1] = 0
        return view


def _view(x: State, u: Input, p: Stage) -> View:
    v2o, v2e = mpcc_ocp.distances(x, p)
    v2o, v2e = (tuple(_smallest(D) for D in group) for group in (v2o, v2e))
    Fz = single_track.loads(x.Fx, p.car)
    F = single_track.tyre_forces(x, u, p.car)
    pose = arc.at(p.path, x.theta)
    return View(
        terms=Weights(**mpcc_ocp.terms(mpcc_ocp.errors(x, u, p), p.weights)),
        v2o=v2o,
        v2e=v2e,
        priority_o=tuple(distance.priority(D, p.D_sft.o) for D in v2o),
        priority_e=tuple(distance.priority(D, p.D_sft.e) for D in v2e),
        friction=Axles(
            f=ca.hypot(F.F_xf, F.F_yf) / (p.car.mu_f * Fz.f),
            r=ca.hypot(F.F_xr, F.F_yr) / (p.car.mu_r * Fz.r),
        ),
        split_ideal=single_track.ideal_split(x.Fx, p.car),
        con=arc.contouring(pose, x.X, x.Y),
        lag=arc.lag(pose, x.X, x.Y),
    )


def _smallest(distances):
    least = distances[0]
    for D in distances[1:]:
        least = ca.fmin(least, D)
    return least
