"""The paper's optimal control problem: errors, cost, constraints, build. SI units, its symbols.

Everything that may change while driving is a number in `Stage`; the graph is built once.
"""

from typing import Any, NamedTuple

import casadi as ca

from mpcc_controller import arc, distance, shooting, single_track, tree
from mpcc_controller.arc import Arc
from mpcc_controller.distance import Disc, Edge, Edges
from mpcc_controller.single_track import Car, Input, State

# The solver's units: forces in kN, everything else as it is
SCALE_X = State(X=1, Y=1, psi=1, vx=1, vy=1, r=1, theta=1, delta=1, Fx=1e3)
SCALE_U = Input(d_delta=1, d_Fx=1e4, lambda_b=1, slack=1)
STATE_TERMS = ('con', 'lag', 'vel', 'v2o', 'v2e')
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


class Safety(NamedTuple):
    """Safety distances D_sft [m] to obstacles and edges."""

    o: Any
    e: Any


class Body(NamedTuple):
    """The circles that stand for the vehicle."""

    radius: Any  # m
    offsets: tuple  # m ahead of the CoG, one per circle


class Stage(NamedTuple):
    """Every number that one stage of the problem needs."""

    car: Car
    weights: Weights
    D_sft: Safety
    body: Body
    path: Arc
    v_ref: Any  # m/s
    centre: Arc  # of the road, along the distance of the path
    half_width: Any  # m, from the centre to the edges
    edges: Edges
    obstacles: tuple[Disc, ...]


class Limited(NamedTuple):
    """The constrained quantities of a stage, in the order of the rows of g."""

    front: Any  # -, longitudinal force over friction, front axle
    rear: Any  # -, rear axle
    total: Any  # -, both axles together
    track: Any  # m, beyond the road (less the slack)
    speed: Any  # m/s (plus the slack)


def template(circles: int, obstacles: int) -> Stage:
    """Return a `Stage` of the given size; its leaves have no meaning."""
    edge = Edge(*Edge._fields)
    return Stage(
        car=Car(*Car._fields),
        weights=Weights(*Weights._fields),
        D_sft=Safety(*Safety._fields),
        body=Body('radius', ('offset',) * circles),
        path=Arc(*Arc._fields),
        v_ref='v_ref',
        centre=Arc(*Arc._fields),
        half_width='half_width',
        edges=Edges(edge, edge),
        obstacles=(Disc(*Disc._fields),) * obstacles,
    )


def distances(x: State, p: Stage):
    """Return D_V2O per obstacle and D_V2E per edge [m], each a list over the vehicle's circles."""
    circles = [distance.circle(x, offset, p.body.radius) for offset in p.body.offsets]
    v2o = [[distance.v2o(c, obstacle) for c in circles] for obstacle in p.obstacles]
    v2e = [list(D) for D in zip(*(distance.v2e(c, p.edges) for c in circles))]
    return v2o, v2e


def state_errors(x: State, p: Stage) -> dict:
    """Return the squared errors of the paper's eq. 4 that depend on the state."""
    pose = arc.at(p.path, x.theta)
    v2o, v2e = distances(x, p)
    return {
        'con': arc.contouring(pose, x.X, x.Y) ** 2,
        'lag': arc.lag(pose, x.X, x.Y) ** 2,
        'vel': (x.vx - p.v_ref) ** 2,
        'v2o': sum(distance.intrusion(D, p.D_sft.o) for circles in v2o for D in circles),
        'v2e': sum(distance.intrusion(D, p.D_sft.e) for circles in v2e for D in circles),
    }


def input_errors(x: State, u: Input, p: Stage) -> dict:
    """Return the squared errors that depend on the input, and the square of the slack."""
    return {
        'd_delta': u.d_delta**2,
        'd_Fx': u.d_Fx**2,
        'lambda_b': (u.lambda_b - single_track.ideal_split(x.Fx, p.car)) ** 2,
        'slack': u.slack**2,
    }


def errors(x: State, u: Input, p: Stage) -> dict:
    """Return every squared error of a stage under the name of its weight."""
    return state_errors(x, p) | input_errors(x, u, p)


def terms(squared: dict, weights: Weights) -> dict:
    """Return the cost terms, the dictionary that is logged."""
    return {name: getattr(weights, name) * error for name, error in squared.items()}


def limited(x: State, u: Input, p: Stage) -> Limited:
    """Return the constrained quantities of the paper's section 3.2."""
    Fz = single_track.loads(x.Fx, p.car)
    F = single_track.split(x.Fx, u.lambda_b, p.car)
    centre = arc.at(p.centre, x.theta)
    away = ca.sqrt((x.X - centre.X) ** 2 + (x.Y - centre.Y) ** 2 + LENGTH_ROUNDING)
    return Limited(
        front=F.f / (p.car.mu_f * Fz.f),
        rear=F.r / (p.car.mu_r * Fz.r),
        total=total_use(x.Fx, p.car),
        track=away - (p.half_width - p.body.radius) - u.slack,
        speed=x.vx + u.slack,
    )


def total_use(Fx, car: Car):
    """Return the total longitudinal force over the friction of both axles (signed)."""
    Fz = single_track.loads(Fx, car)
    return Fx / (car.mu_f * Fz.f + car.mu_r * Fz.r)


def build(horizon: int, dt: float, circles: int, obstacles: int) -> shooting.StageProblem:
    """Build the problem once; afterwards only numbers change, never the graph.

    `horizon` is the number of steps of `dt` [s]; `circles` and `obstacles` fix the size of
    `Stage`.
    """
    shape = template(circles, obstacles)
    xs, us = ca.SX.sym('x', len(State._fields)), ca.SX.sym('u', len(Input._fields))
    ps = ca.SX.sym('p', len(tree.leaves(shape)))
    x, u = State(*ca.vertsplit(xs)), Input(*ca.vertsplit(us))
    p = tree.fill(shape, ca.vertsplit(ps))

    rates = ca.Function('rates', [xs, us, ps], [ca.vertcat(*single_track.derivative(x, u, p.car))])
    step = shooting.rk2(rates, dt)
    stage = sum(terms(errors(x, u, p), p.weights).values())
    last = sum(terms(state_errors(x, p), p.weights).values())
    return shooting.StageProblem(
        name='mpcc',
        states=State._fields,
        inputs=Input._fields,
        parameters=tree.names(shape),
        horizon=horizon,
        dynamics=ca.Function('dynamics', [xs, us, ps], [step(xs, us, ps)]),
        stage_cost=ca.Function('stage_cost', [xs, us, ps], [stage]),
        terminal_cost=ca.Function('terminal_cost', [xs, ps], [last]),
        constraints=ca.Function('constraints', [xs, us, ps], [ca.vertcat(*limited(x, u, p))]),
        terminal_constraints=ca.Function(
            'terminal_constraints', [xs, ps], [total_use(x.Fx, p.car)]
        ),
        scale_x=SCALE_X,
        scale_u=SCALE_U,
    )
