"""Refuses a problem that no solver can use, when a controller starts. SI units.

Every cost term, state equation and constraint is evaluated, with its first and second derivatives,
at some hundred states: on the path and around it, at the limits, and at rest, where a root or a
norm of an error has no derivative. What is not finite there would stop solves while the car drives.
"""

from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from mpcc_controller.model.single_track import Input, State
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.path import reference_path, road_edges
from mpcc_controller.path.reference_path import ReferencePath
from mpcc_controller.problem import ocp
from mpcc_controller.problem.cost_term_check import CostTermError
from mpcc_controller.problem.formulation import Formulation
from mpcc_controller.problem.ocp import SymbolicOcp
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.types import Obstacle, Obstacles, Reference, RoadEdges
from node_runtime import named_vector
from node_runtime.parameters import ParameterError
from stage_solver.stage_problem import MAX_CACHED_PROBLEMS, Plan

RANDOM_STATES = 300
# how far the states are from rest on the path, either way; limits give the others
SPREAD = {'vy': 5.0, 'r': 1.5, 'psi': 1.0, 'slack': 1.0}
BESIDE_M = 5.0  # of the path, either way
DESIRED_MPS, GREATEST_MPS = 20.0, 60.0
# the path: straight, then a bend to the left
REST_AT_M, BEND_AT_M, LENGTH_M, CURVATURE_1PM = 10.0, 30.0, 120.0, 0.02
HALF_WIDTH_M = 4.0
OBSTACLE = Obstacle(1, 40.0, 2.0, 0.8, 2.0, 0.5)
ROUNDING = 1e-9  # by which a squared error may be below 0
SHOWN = 5  # quantities in a message


class _Function(NamedTuple):
    """One function of the problem."""

    name: str  # how a message calls it
    is_cost: bool
    expression: Any  # CasADi


def check(formulation: Formulation, params: ControllerParams) -> None:
    """Raise ParameterError for a function that is not finite, with its derivatives, somewhere.

    Or a cost term, then CostTermError, whose squared error is negative. The message names the
    function, the quantity by which it is derived, and the state. `params` are those in force.
    """
    scene = _scene()
    X, U = _samples(params, scene.path)
    P = formulation.stage_parameters(scene, X).P
    local = formulation.to_local(Plan(X, U), scene.path).X
    for has_input in (True, False):
        _check_stage(formulation.ocp, has_input, local, U, P)


def _check_stage(symbolic, has_input, X, U, P):
    """Check the functions of a stage, or of the last one, which has no input."""
    functions, derivatives = _derivatives(symbolic, has_input)
    names, points = (*symbolic.state._fields, *Input._fields), np.column_stack((X, U))
    tables = (np.array(table) for table in derivatives(X.T, U.T, P.T))
    shape = len(functions), -1, len(points)
    values, gradients, curvatures = (table.reshape(shape) for table in tables)
    for function, *own in zip(functions, values, gradients, curvatures):
        fault = _find_fault(function.is_cost, names, *own)
        if fault:
            sample, what = fault
            where = _describe(function, symbolic, names, points[sample])
            sign = '; a squared error must not be negative either' if function.is_cost else ''
            raise (CostTermError if function.is_cost else ParameterError)(
                f'{function.name}: {what} at {where}; value, first and second derivatives must be '
                f'finite wherever the car may be{sign}'
            )


def _find_fault(is_cost, names, value, gradient, curvature):
    """Return the first sample at which a function cannot be used and what is wrong, or None."""
    tables = (
        ('its value is', ('',), value),
        ('its derivative by {} is', names, gradient),
        ('its second derivative by {} is', names, curvature),
    )
    for text, by, table in tables:
        samples, rows = np.nonzero(~np.isfinite(table.T))
        if len(samples):
            return samples[0], f'{text.format(by[rows[0]])} {table[rows[0], samples[0]]:g}'
    if is_cost and value.min() < -ROUNDING:
        return np.argmin(value), f'its value is {value.min():.4g}'
    return None


def _describe(function, symbolic, names, point):
    """Return the sample by the quantities that the function depends on."""
    xs, us, _ = _symbols(symbolic).flat
    used = ca.which_depends(function.expression, ca.vertcat(xs, us), 1, False)
    shown = [f'{name} = {value:.4g}' for name, value, is_used in zip(names, point, used) if is_used]
    more = [f'{len(shown) - SHOWN} more'] if len(shown) > SHOWN else []
    return ', '.join(shown[:SHOWN] + more) or 'every state'


@lru_cache(MAX_CACHED_PROBLEMS)
def _symbols(symbolic):
    return ocp.symbols(symbolic)


@lru_cache(2 * MAX_CACHED_PROBLEMS)
def _derivatives(symbolic: SymbolicOcp, has_input: bool) -> tuple[tuple[_Function, ...], Any]:
    """Return the functions of a stage, and (X, U, P) -> values and derivatives, sample by column.

    The second derivatives are sums of magnitudes: they are finite where every element is.
    """
    (xs, us, ps), *_ = _symbols(symbolic)
    functions = tuple(_functions(symbolic, has_input))
    gradients, curvatures = [], []
    for function in functions:
        hessian, gradient = ca.hessian(function.expression, ca.vertcat(xs, us))
        gradients.append(ca.densify(gradient))
        curvatures.append(ca.densify(ca.sum2(ca.fabs(hessian))))
    tables = ([function.expression for function in functions], gradients, curvatures)
    return functions, ca.Function('check', [xs, us, ps], [ca.vertcat(*rows) for rows in tables])


def _functions(symbolic, has_input) -> Iterator[_Function]:
    _, x, u, p = _symbols(symbolic)
    titles = {term.name: term.title for term in symbolic.terms}
    for name, error in symbolic.errors(x, u if has_input else None, p).items():
        yield _Function(titles[name], True, ca.SX(error))
    if has_input:
        for name, value in _built('state equations', symbolic.rates, x, u, p).items():
            yield _Function(f"the rate of the state '{name}'", False, ca.SX(value))
        for name, values in _built('constraints', symbolic.constraints, x, u, p).items():
            for value in named_vector.leaves((values,)):
                yield _Function(f"the constraint '{name}'", False, ca.SX(value))


def _built(what, build: Callable, x, u, p) -> dict[str, Any]:
    try:
        return build(x, u, p)._asdict()
    except Exception as error:
        raise ParameterError(
            f'the {what} cannot be built: {type(error).__name__}: {error}'
        ) from error


@lru_cache(1)
def _scene() -> Scene:
    """Return a path with a bend, a road around it, and one obstacle that moves."""
    theta = np.arange(0.0, LENGTH_M + 1.0)
    turned = CURVATURE_1PM * np.maximum(theta - BEND_AT_M, 0.0)
    X = np.minimum(theta, BEND_AT_M) + np.sin(turned) / CURVATURE_1PM
    Y = (1 - np.cos(turned)) / CURVATURE_1PM
    aside = HALF_WIDTH_M * np.column_stack((-np.sin(turned), np.cos(turned)))
    middle = np.column_stack((X, Y))
    return Scene(
        reference_path.build(Reference(0, X, Y, turned, theta / DESIRED_MPS)),
        road_edges.build(RoadEdges(0, middle + aside, middle - aside)),
        Obstacles(0, (OBSTACLE,)),
    )


def _samples(params: ControllerParams, path: ReferencePath) -> tuple[np.ndarray, np.ndarray]:
    """Return states in the map (n, 9) and inputs (n, 4).

    The first sample is on the straight path at the desired speed, where errors are exactly 0; then
    each quantity differs from that alone, either way; then all of them do.
    """
    limits = params.limits
    low = {name: -value for name, value in SPREAD.items()} | {
        'vx': 0.0 if params.model.low_speed else limits.least_speed_mps,
        'delta': -limits.steer_rad,
        'Fx': -limits.brake_n,
        'd_delta': -limits.steer_rate_radps,
        'd_Fx': -limits.force_rate_nps,
        'lambda_b': limits.brake_front_share_min,
        'beside': -BESIDE_M,
        'theta': 0.0,
    }
    high = {name: -value for name, value in low.items()} | {
        'vx': GREATEST_MPS,
        'Fx': limits.drive_n,
        'lambda_b': limits.brake_front_share_max,
        'theta': LENGTH_M,
    }
    rest = dict.fromkeys(low, 0.0) | {
        'vx': DESIRED_MPS,
        'lambda_b': high['lambda_b'],
        'theta': REST_AT_M,
    }
    names = tuple(rest)
    at_rest, lowest, highest = (np.array([v[name] for name in names]) for v in (rest, low, high))
    alone = np.repeat(at_rest[None], 2 * len(names), axis=0)
    np.fill_diagonal(alone[::2], lowest)
    np.fill_diagonal(alone[1::2], highest)
    random = np.random.default_rng(0).uniform(lowest, highest, (RANDOM_STATES, len(names)))
    quantities = dict(zip(names, np.vstack((at_rest[None], alone, random)).T))
    arcs, _ = reference_path.arcs_at(path, quantities['theta'])
    beside = quantities['beside']
    quantities['X'] = arcs.X - beside * np.sin(arcs.psi)
    quantities['Y'] = arcs.Y + beside * np.cos(arcs.psi)
    quantities['psi'] = quantities['psi'] + arcs.psi
    states, inputs = ([quantities[name] for name in kind._fields] for kind in (State, Input))
    return np.column_stack(states), np.column_stack(inputs)
