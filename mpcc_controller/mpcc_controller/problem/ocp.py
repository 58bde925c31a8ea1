"""From a formulation in symbols to a stage problem: what all formulations have in common.

A formulation is its states, its numbers per stage, its errors and its limits; the inputs, the
integrator, the sum of the cost and what is told about a plan are the same for all.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca

from mpcc_controller.model import single_track, tree
from mpcc_controller.model.single_track import Car, Input
from mpcc_controller.path import distance
from mpcc_controller.problem import measure
from mpcc_controller.problem.measure import Measure
from stage_solver.stage_problem import StageProblem, rk2

# The solver's units of the inputs: forces in kN, everything else as it is
SCALE_U = Input(d_delta=1, d_Fx=1e4, lambda_b=1, slack=1)


class Safety(NamedTuple):
    """Safety distances D_sft [m] to obstacles and edges."""

    o: Any
    e: Any


class Body(NamedTuple):
    """The circles that stand for the vehicle."""

    radius: Any  # m
    offsets: tuple  # m ahead of the CoG, one per circle


class Limited(NamedTuple):
    """The constrained quantities of a stage, in the order of the rows of g."""

    front: Any  # -, longitudinal force over friction, front axle
    rear: Any  # -, rear axle
    total: Any  # -, both axles together
    track: Any  # m, beyond the road (less the slack)
    speed: Any  # m/s (plus the slack)


class Rules(NamedTuple):
    """What can be exchanged in the cost of a formulation."""

    measure: Measure  # of the distances
    priority: Callable[[Any, Any], Any]  # (D, D_sft) -> q / P_k
    heading: bool = False  # whether the states of the map have a heading error


PAPER = Rules(measure.CARTESIAN, distance.priority)
PRIORITIES = {'gaussian': distance.priority, 'step': distance.step_priority}


class Formula(NamedTuple):
    """One formulation in symbols; x, u, p are the state, the input and the numbers of a stage."""

    name: str  # a C identifier
    state: type  # a NamedTuple that has vx, vy, r, delta and Fx
    shape: Any  # template of the numbers of a stage
    scale_x: tuple  # SI units per solver unit
    rates: Callable  # (x, u, p) -> dx/dt, a `state`
    state_errors: Callable  # (x, p) -> squared errors by the name of their weight
    input_errors: Callable  # (x, u, p) -> the same
    limited: Callable  # (x, u, p) -> `Limited`
    distances: Callable  # (x, p) -> D per obstacle, D per edge
    priority: Callable  # (D, D_sft) -> q / P_k
    tracking: Callable  # (x, p) -> the errors of tracking that are told, a NamedTuple


class Symbols(NamedTuple):
    """The arguments of a stage's functions, flat and named."""

    flat: tuple  # xs, us, ps
    x: Any
    u: Any
    p: Any


def symbols(formula: Formula) -> Symbols:
    """Return fresh symbols for the functions of a formulation."""
    xs, us = ca.SX.sym('x', len(formula.state._fields)), ca.SX.sym('u', len(Input._fields))
    ps = ca.SX.sym('p', len(tree.leaves(formula.shape)))
    x, u = formula.state(*ca.vertsplit(xs)), Input(*ca.vertsplit(us))
    return Symbols((xs, us, ps), x, u, tree.fill(formula.shape, ca.vertsplit(ps)))


def terms(squared: dict, weights) -> dict:
    """Return the cost terms, the dictionary that is logged."""
    return {name: getattr(weights, name) * error for name, error in squared.items()}


def errors(formula: Formula, x, u: Input, p) -> dict:
    """Return every squared error of a stage under the name of its weight."""
    return formula.state_errors(x, p) | formula.input_errors(x, u, p)


def input_errors(x, u: Input, p) -> dict:
    """Return the squared errors that depend on the input, and the square of the slack."""
    return {
        'd_delta': u.d_delta**2,
        'd_Fx': u.d_Fx**2,
        'lambda_b': (u.lambda_b - single_track.ideal_split(x.Fx, p.car)) ** 2,
        'slack': u.slack**2,
    }


def distance_errors(v2o, v2e, D_sft: Safety, priority) -> dict:
    """Return the errors of the distances (paper, section 3.3): a list per obstacle and per edge."""
    return {
        'v2o': sum(distance.intrusion(D, D_sft.o, priority) for ring in v2o for D in ring),
        'v2e': sum(distance.intrusion(D, D_sft.e, priority) for ring in v2e for D in ring),
    }


def limited(x, u: Input, p, outside) -> Limited:
    """Return the constrained quantities (paper, section 3.2).

    `outside` [m] is how far the centre of gravity is beyond the track, less than 0 on it.
    """
    Fz = single_track.loads(x.Fx, p.car)
    F = single_track.split(x.Fx, u.lambda_b, p.car)
    return Limited(
        front=F.f / (p.car.mu_f * Fz.f),
        rear=F.r / (p.car.mu_r * Fz.r),
        total=total_use(x.Fx, p.car),
        track=outside - u.slack,
        speed=x.vx + u.slack,
    )


def total_use(Fx, car: Car):
    """Return the total longitudinal force over the friction of both axles (signed)."""
    Fz = single_track.loads(Fx, car)
    return Fx / (car.mu_f * Fz.f + car.mu_r * Fz.r)


def build(formula: Formula, horizon: int, dt: float) -> StageProblem:
    """Build the problem once; afterwards only numbers change, never the graph.

    `horizon` is the number of steps of `dt` [s].
    """
    (xs, us, ps), x, u, p = symbols(formula)
    rates = ca.Function('rates', [xs, us, ps], [ca.vertcat(*formula.rates(x, u, p))])
    step = rk2(rates, dt)
    stage = sum(terms(errors(formula, x, u, p), p.weights).values())
    last = sum(terms(formula.state_errors(x, p), p.weights).values())
    return StageProblem(
        name=formula.name,
        states=formula.state._fields,
        inputs=Input._fields,
        parameters=tree.names(formula.shape),
        horizon=horizon,
        dynamics=ca.Function('dynamics', [xs, us, ps], [step(xs, us, ps)]),
        stage_cost=ca.Function('stage_cost', [xs, us, ps], [stage]),
        terminal_cost=ca.Function('terminal_cost', [xs, ps], [last]),
        constraints=ca.Function(
            'constraints', [xs, us, ps], [ca.vertcat(*formula.limited(x, u, p))]
        ),
        terminal_constraints=ca.Function(
            'terminal_constraints', [xs, ps], [total_use(x.Fx, p.car)]
        ),
        scale_x=formula.scale_x,
        scale_u=SCALE_U,
    )
