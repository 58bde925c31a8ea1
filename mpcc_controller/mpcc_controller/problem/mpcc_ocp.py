"""The paper's optimal control problem: errors, cost, constraints. SI units, its symbols.

Everything that may change while driving is a number in `Stage`; the graph is built once.
"""

from collections import namedtuple
from functools import partial
from typing import Any, NamedTuple

import casadi as ca

from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, Input, State
from mpcc_controller.path import arc, distance
from mpcc_controller.path.arc import Arc
from mpcc_controller.problem import ocp
from mpcc_controller.problem.ocp import PAPER, Body, Formula, Limited, Rules, Safety
from stage_solver.stage_problem import StageProblem

# The solver's units: forces in kN, everything else as it is
SCALE_X = State(X=1, Y=1, psi=1, vx=1, vy=1, r=1, theta=1, delta=1, Fx=1e3)
LENGTH_ROUNDING = 1e-4  # m^2; 1 cm, the distance to the centre of the track has a tip there


class Weights(NamedTuple):
    """The factor of each squared error; for v2o and v2e the paper's P_k."""

    con: Any
    lag: Any
    vel: Any
    d_delta: Any
    d_Fx: Any
    lambda_b: Any
    v2o: Any
    v2e: Any
    slack: Any


# with the factor of the heading error, which the paper's cost does not have
HeadingWeights = namedtuple('HeadingWeights', (*Weights._fields, 'dpsi'))


class Stage(NamedTuple):
    """Every number that one stage of the problem needs."""

    car: Car
    weights: Weights | HeadingWeights
    D_sft: Safety
    body: Body
    path: Arc
    v_ref: Any  # m/s
    centre: Arc  # of the road, along the distance of the path
    half_width: Any  # m, from the centre to the edges
    edges: Any  # as the measure of the distances has them
    obstacles: tuple  # the same


class Tracking(NamedTuple):
    """How far the vehicle is from where it should be."""

    con: Any  # m, right of the path positive
    lag: Any  # m, behind positive


def template(circles: int, obstacles: int, rules: Rules = PAPER) -> Stage:
    """Return a `Stage` of the given size; its leaves have no meaning."""
    kind = HeadingWeights if rules.heading else Weights
    return Stage(
        car=Car(*Car._fields),
        weights=kind(*kind._fields),
        D_sft=Safety(*Safety._fields),
        body=Body('radius', ('offset',) * circles),
        path=Arc(*Arc._fields),
        v_ref='v_ref',
        centre=Arc(*Arc._fields),
        half_width='half_width',
        edges=rules.measure.edges,
        obstacles=(rules.measure.disc,) * obstacles,
    )


def distances(x: State, p: Stage, rules: Rules = PAPER):
    """Return D_V2O per obstacle and D_V2E per edge [m], each a list over the vehicle's circles."""
    circles = [distance.circle(x, offset, p.body.radius) for offset in p.body.offsets]
    return rules.measure.distances(circles, p)


def tracking(x: State, p: Stage) -> Tracking:
    """Return the contouring and the lag error (paper, section 3.1)."""
    pose = arc.at(p.path, x.theta)
    return Tracking(arc.contouring(pose, x.X, x.Y), arc.lag(pose, x.X, x.Y))


def state_errors(x: State, p: Stage, rules: Rules = PAPER) -> dict:
    """Return the squared errors of the paper's eq. 4 that depend on the state."""
    e = tracking(x, p)
    found = {'con': e.con**2, 'lag': e.lag**2, 'vel': (x.vx - p.v_ref) ** 2}
    if rules.heading:
        found['dpsi'] = heading_error(x, p)
    return found | ocp.distance_errors(*distances(x, p, rules), p.D_sft, rules.priority)


def heading_error(x: State, p: Stage):
    """Return the squared error of the heading [rad^2], the same for whole turns more or less.

    2 (1 - cos) is the square to 1 % at 20 deg. The heading of the path goes on counting over
    laps, that of the car may not.
    """
    return 2 * (1 - ca.cos(x.psi - arc.at(p.path, x.theta).psi))


def limited(x: State, u: Input, p: Stage) -> Limited:
    """Return the constrained quantities of the paper's section 3.2."""
    centre = arc.at(p.centre, x.theta)
    away = ca.sqrt((x.X - centre.X) ** 2 + (x.Y - centre.Y) ** 2 + LENGTH_ROUNDING)
    return ocp.limited(x, u, p, away - (p.half_width - p.body.radius))


def formula(circles: int, obstacles: int, rules: Rules = PAPER) -> Formula:
    """Return the formulation for vehicle circles and obstacles of the given numbers."""
    return Formula(
        name='mpcc',
        state=State,
        shape=template(circles, obstacles, rules),
        scale_x=SCALE_X,
        rates=lambda x, u, p: single_track.derivative(x, u, p.car),
        state_errors=partial(state_errors, rules=rules),
        input_errors=ocp.input_errors,
        limited=limited,
        distances=partial(distances, rules=rules),
        priority=rules.priority,
        tracking=tracking,
    )


def build(horizon: int, dt: float, circles: int, obstacles: int) -> StageProblem:
    """Return the paper's problem with `horizon` steps of `dt` [s]."""
    return ocp.build(formula(circles, obstacles), horizon, dt)
