"""From a formulation in symbols to a stage problem: what all formulations share.

A formulation defines its states, stage parameters, cost terms and constraints. Inputs, integrator,
the sum of the cost and the evaluation of plans are the same for all.
"""

from collections.abc import Callable, Sequence
from functools import cache, lru_cache, reduce
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Axles, Car, Input
from mpcc_controller.problem import cost_terms
from mpcc_controller.problem.cost_terms import CostTerm
from mpcc_controller.problem.distance_frame import DistanceFrame
from node_runtime import named_vector
from stage_solver import stage_problem
from stage_solver.compiled_functions import BufferedFunction
from stage_solver.stage_problem import MAX_CACHED_PROBLEMS, Plan

LENGTH_ROUNDING = 1e-4  # m^2; 1 cm, keeps the distance to the centre of the track differentiable
# The solver's units: forces in kN, their rates in 10 kN/s, everything else in SI
SCALE_FX, SCALE_U = 1e3, Input(d_delta=1, d_Fx=1e4, lambda_b=1, slack=1)


class SafetyDistance(NamedTuple):
    """Safety distances D_sft [m] to obstacles and edges."""

    o: Any
    e: Any


class VehicleCircles(NamedTuple):
    """The circles that cover the vehicle."""

    radius: Any  # m
    offsets: tuple  # m ahead of the CoG, one per circle
    edge_radius: Any  # m, of the same circles at road edges


class Constraints(NamedTuple):
    """The constrained quantities of a stage, in the order of the rows of g.

    The total force over the friction of both axles is between those of the axles.
    """

    front: Any  # -, longitudinal force over friction, front axle
    rear: Any  # -, rear axle
    track: tuple  # m, beyond the road (less the slack), of every `track_offsets`


class SymbolicOcp(NamedTuple):
    """A formulation in symbols; x, u, p are the state, the input and the parameters of a stage."""

    name: str  # a C identifier
    state: type  # a NamedTuple that has vx, vy, r, delta and Fx
    template: Any  # stage parameters whose leaves have no meaning
    rates: Callable  # (x, u, p) -> dx/dt, a `state`
    terms: tuple[CostTerm, ...]
    quantities: Callable  # (x, u or None, p) -> StageQuantities
    constraints: Callable  # (x, u, p) -> Constraints

    def errors(self, x, u, p) -> dict[str, Any]:
        """Return the squared errors of a stage by name; without `u` those of the last stage."""
        return cost_terms.squared_errors(self.terms, self.quantities(x, u, p))


class Rules(NamedTuple):
    """What can be exchanged in the cost of a formulation."""

    frame: DistanceFrame
    priority: Any  # (D, D_sft) -> q / P_k
    terms: tuple[CostTerm, ...]
    car: Car  # its structure


def symbols(ocp: SymbolicOcp) -> tuple[tuple[ca.SX, ca.SX, ca.SX], Any, Input, Any]:
    """Return new symbols of x, u and p of a stage, first flat, then each of them by names."""
    xs, us = ca.SX.sym('x', len(ocp.state._fields)), ca.SX.sym('u', len(Input._fields))
    ps = ca.SX.sym('p', len(named_vector.leaves(ocp.template)))
    x, u = ocp.state(*ca.vertsplit(xs)), Input(*ca.vertsplit(us))
    p = named_vector.build(ocp.template, ca.vertsplit(ps))
    p = p._replace(car=single_track.car_of(ocp.template.car, p.car))
    return (xs, us, ps), x, u, p


def constraints(x, u: Input, p, beyond_track: Sequence) -> Constraints:
    """Return the constrained quantities (paper, section 3.2).

    `beyond_track` [m] is how far each circle is beyond the track, negative on it.
    """
    Fz = single_track.loads(x.Fx, p.car)
    F = single_track.split(x.Fx, u.lambda_b, p.car)
    return Constraints(
        front=F.f / (p.car.mu_f * Fz.f),
        rear=F.r / (p.car.mu_r * Fz.r),
        track=tuple(beyond - u.slack for beyond in beyond_track),
    )


def track_offsets(body) -> tuple:
    """Return where along the car [m ahead of the CoG] circles must be on the track.

    Of a single circle, as in the paper, the CoG. Of several the centres; where they are smaller at
    edges, the outer ones move to the ends of what the set covers: it is as wide as the car there,
    too.
    """
    if len(body.offsets) == 1:
        return (0.0,)
    half_share = ca.sqrt(ca.fmax(body.radius**2 - body.edge_radius**2, 0))
    first, *between, last = body.offsets
    return (first - half_share, *between, last + half_share)


def total_friction_use(Fx, car: Car):
    """Return the total longitudinal force over the friction of both axles (signed)."""
    Fz = single_track.loads(Fx, car)
    return Fx / (car.mu_f * Fz.f + car.mu_r * Fz.r)


@lru_cache(MAX_CACHED_PROBLEMS)
def build(ocp: SymbolicOcp, horizon: int, dt: float) -> stage_problem.StageProblem:
    """Build the problem of `horizon` steps of `dt` [s]; afterwards only its parameters change."""
    (xs, us, ps), x, u, p = symbols(ocp)
    rates = ca.Function('rates', [xs, us, ps], [ca.vertcat(*ocp.rates(x, u, p))])
    step = stage_problem.rk2(rates, dt)
    stage = sum(cost_terms.costs(ocp.errors(x, u, p), p.weights).values())
    last = sum(cost_terms.costs(ocp.errors(x, None, p), p.weights).values())
    return stage_problem.StageProblem(
        name=ocp.name,
        states=ocp.state._fields,
        inputs=Input._fields,
        parameters=named_vector.names(ocp.template),
        horizon=horizon,
        dynamics=ca.Function('dynamics', [xs, us, ps], [step(xs, us, ps)]),
        stage_cost=ca.Function('stage_cost', [xs, us, ps], [stage]),
        terminal_cost=ca.Function('terminal_cost', [xs, ps], [last]),
        constraints=ca.Function(
            'constraints',
            [xs, us, ps],
            [ca.vertcat(*named_vector.leaves(ocp.constraints(x, u, p)))],
        ),
        terminal_constraints=ca.Function(
            'terminal_constraints', [xs, ps], [total_friction_use(x.Fx, p.car)]
        ),
        scale_x=tuple(SCALE_FX if name == 'Fx' else 1 for name in ocp.state._fields),
        scale_u=SCALE_U,
    )


# evaluation of plans


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
    flat, x, u, p = symbols(symbolic)
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
