"""The baseline's optimal control problem, in coordinates along the coarse path. SI units.

Brown & Gerdes, "Coordinating tire forces to avoid obstacles using nonlinear model predictive
control", IEEE T-IV 2019, as far as it is public; docs/baseline.md says of every choice where it
comes from. Inputs, prediction model and limits are those of the paper's MPCC.
"""

from functools import partial
from typing import Any, NamedTuple

import casadi as ca

from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, Input
from mpcc_controller.path import path_distance, path_frame
from mpcc_controller.path.path_distance import PathEdges
from mpcc_controller.path.path_frame import Place
from mpcc_controller.problem import measure, ocp
from mpcc_controller.problem.ocp import Body, Formula, Limited, Rules, Safety


class PathState(NamedTuple):
    """State x of the baseline."""

    s: Any  # m along the path
    e: Any  # m, left of the path positive
    dpsi: Any  # rad, heading relative to the path
    vx: Any  # m/s, body
    vy: Any  # m/s, body
    r: Any  # rad/s
    delta: Any  # rad, road-wheel angle
    Fx: Any  # N, total longitudinal force


# The solver's units: forces in kN, everything else as it is
SCALE_X = PathState(s=1, e=1, dpsi=1, vx=1, vy=1, r=1, delta=1, Fx=1e3)
LENGTH_ROUNDING = 1e-4  # m^2; 1 cm, the distance to the centre of the track has a tip there


class PathWeights(NamedTuple):
    """The factor of each squared error; for v2o and v2e the weight of an intrusion."""

    e: Any
    dpsi: Any
    vel: Any
    d_delta: Any
    d_Fx: Any
    lambda_b: Any
    v2o: Any
    v2e: Any
    slack: Any


class PathStage(NamedTuple):
    """Every number that one stage of the problem needs."""

    car: Car
    weights: PathWeights
    D_sft: Safety
    body: Body
    kappa: Any  # 1/m, mean curvature of the path over the step, left positive
    v_ref: Any  # m/s
    edges: PathEdges
    obstacles: tuple  # of PathDisc


class PathTracking(NamedTuple):
    """How far the vehicle is from where it should be."""

    e: Any  # m, left of the path positive
    dpsi: Any  # rad


def template(circles: int, obstacles: int) -> PathStage:
    """Return a `PathStage` of the given size; its leaves have no meaning."""
    return PathStage(
        car=Car(*Car._fields),
        weights=PathWeights(*PathWeights._fields),
        D_sft=Safety(*Safety._fields),
        body=Body('radius', ('offset',) * circles),
        kappa='kappa',
        v_ref='v_ref',
        edges=measure.PATH.edges,
        obstacles=(measure.PATH.disc,) * obstacles,
    )


def rates(x: PathState, u: Input, p: PathStage) -> PathState:
    """Return dx/dt: the paper's body in path coordinates."""
    body = single_track.body_rates(x, u, p.car)
    place = path_frame.rates(x.e, x.dpsi, p.kappa, x.vx, x.vy, x.r)
    return PathState(*place, *body, delta=u.d_delta, Fx=u.d_Fx)


def distances(x: PathState, p: PathStage):
    """Return D_V2O per obstacle and D_V2E per edge [m], each a list over the vehicle's circles."""
    along, across = ca.cos(x.dpsi), ca.sin(x.dpsi)
    places = [Place(x.s + ahead * along, x.e + ahead * across) for ahead in p.body.offsets]
    return path_distance.of_places(places, p)


def state_errors(x: PathState, p: PathStage, priority) -> dict:
    """Return the squared errors that depend on the state; there is no lag error."""
    found = {'e': x.e**2, 'dpsi': x.dpsi**2, 'vel': (x.vx - p.v_ref) ** 2}
    return found | ocp.distance_errors(*distances(x, p), p.D_sft, priority)


def limited(x: PathState, u: Input, p: PathStage) -> Limited:
    """Return the constrained quantities, the same as those of the MPCC."""
    left, right = (path_distance.offset(edge, x.s) for edge in p.edges)
    away = ca.sqrt((x.e - (left + right) / 2) ** 2 + LENGTH_ROUNDING)
    return ocp.limited(x, u, p, away - ((left - right) / 2 - p.body.radius))


def formula(circles: int, obstacles: int, rules: Rules) -> Formula:
    """Return the formulation for vehicle circles and obstacles of the given numbers."""
    return Formula(
        name='frenet',
        state=PathState,
        shape=template(circles, obstacles),
        scale_x=SCALE_X,
        rates=rates,
        state_errors=partial(state_errors, priority=rules.priority),
        input_errors=ocp.input_errors,
        limited=limited,
        distances=distances,
        priority=rules.priority,
        tracking=lambda x, p: PathTracking(x.e, x.dpsi),
    )
