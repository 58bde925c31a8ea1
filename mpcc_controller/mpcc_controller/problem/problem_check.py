"""Refuses a problem that no solver can use, when a controller starts. SI units.

Every cost term, state equation and constraint is evaluated, with its first and second derivatives,
at some hundred states: on the path and around it, at the limits, and at rest, where a root or a
norm of an error has no derivative. What is not finite there would stop solves while the car drives.
"""

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from mpcc_controller.model.single_track import Input, State
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.path import frenet_frame, reference_path, road_edges
from mpcc_controller.path.reference_path import ReferencePath
from mpcc_controller.problem import ocp
from mpcc_controller.problem.cost_terms import CostTermError
from mpcc_controller.problem.formulation import Formulation
from mpcc_controller.problem.obstacle_motion import PredictedObstacle
from mpcc_controller.problem.ocp import SymbolicOcp
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.types import Obstacles, Reference, RoadEdges
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
OBSTACLE = PredictedObstacle(1, 40.0, 2.0, 0.8, 2.0, 0.5)
ROUNDING = 1e-9  # by which a squared error may be below 0
SHOWN = 5  # quantities in a message


def check(formulation: Formulation, params: ControllerParams) -> None:
    """Raise ParameterError for a function that is not finite, with its derivatives, somewhere.

    Or a cost term, then CostTermError, whose squared error is negative. The message names the
    function, the quantity by which it is derived, and the state. `params` are those in force.
    """
    scene = _scene()
    X, U = _samples(params, scene.path)
    P = formulation.stage_parameters(scene, X).P
    local = formulation.to_local(Plan(X, U), scene.path).X
    names, points = (*formulation.ocp.state._fields, *Input._fields), np.column_stack((local, U))
    for has_input in (True, False):
        functions, derivatives = _derivatives(formulation.ocp, has_input)
        shape = len(functions), -1, len(points)
        tables = (np.array(t).reshape(shape) for t in derivatives(local.T, U.T, P.T))
        for function, *own in zip(functions, *tables):
            _check_function(function, names, points, *own)


def _check_function(function, names, points, value, gradient, curvature):
    """Raise for the first sample at which a function or a derivative cannot be used."""
    title, is_cost, depends = function
    sample, what, sign = None, '', ''
    for text, by, table in (
        ('its value is', ('',), value),
        ('its derivative by {} is', names, gradient),
        ('its second derivative by {} is', names, curvature),
    ):
        samples, rows = np.nonzero(~np.isfinite(table.T))
        if len(samples):
            sample = samples[0]
            what = f'{text.format(by[rows[0]])} {table[rows[0], sample]:g}'
            break
    if sample is None and is_cost and value.min() < -ROUNDING:
        sample, what = np.argmin(value), f'its value is {value.min():.4g}'
    if sample is None:
        return
    # the sample by the quantities that the function depends on
    shown = [
        f'{name} = {number:.4g}'
        for name, number, is_used in zip(names, points[sample], depends)
        if is_used
    ]
    more = [f'{len(shown) - SHOWN} more'] if len(shown) > SHOWN else []
    where = ', '.join(shown[:SHOWN] + more) or 'every state'
    if is_cost:
        sign = '; a squared error must not be negative either'
    raise (CostTermError if is_cost else ParameterError)(
        f'{title}: {what} at {where}; value, first and second derivatives must be '
        f'finite wherever the car may be{sign}'
    )


@lru_cache(2 * MAX_CACHED_PROBLEMS)
def _derivatives(symbolic: SymbolicOcp, has_input: bool) -> tuple[list[tuple], Any]:
    """Return the functions of a stage, and (X, U, P) -> values and derivatives, sample by column.

    Of each function its title, whether it is a cost, and on which states and inputs it depends.

    Without an input, of the last stage. The second derivatives are sums of magnitudes: they are
    finite where every element is.
    """
    (xs, us, ps), x, u, p = ocp.symbols(symbolic)
    variables = ca.vertcat(xs, us)
    titles = {term.name: term.title for term in symbolic.terms}
    errors = symbolic.errors(x, u if has_input else None, p)
    expressions = [(titles[name], True, error) for name, error in errors.items()]
    parts = {
        'state equations': ("the rate of the state '{}'", symbolic.rates),
        'constraints': ("the constraint '{}'", symbolic.constraints),
    }
    for what, (title, build) in parts.items() if has_input else ():
        try:
            built = build(x, u, p)._asdict()
        except Exception as error:
            raise ParameterError(
                f'the {what} cannot be built: {type(error).__name__}: {error}'
            ) from error
        for name, values in built.items():
            leaves = named_vector.leaves((values,))
            expressions += [(title.format(name), False, value) for value in leaves]
    functions, tables = [], ([], [], [])
    for name, is_cost, expression in expressions:
        expression = ca.SX(expression)
        hessian, gradient = ca.hessian(expression, variables)
        curvature = ca.densify(ca.sum2(ca.fabs(hessian)))
        for table, rows in zip(tables, (expression, ca.densify(gradient), curvature)):
            table.append(rows)
        depends = ca.which_depends(expression, variables, 1, False)
        functions.append((name, is_cost, depends))
    return functions, ca.Function('check', [xs, us, ps], [ca.vertcat(*rows) for rows in tables])


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
    quantities['X'], quantities['Y'], _ = frenet_frame.offset_left(arcs, quantities['beside'])
    quantities['psi'] = quantities['psi'] + arcs.psi
    states, inputs = ([quantities[name] for name in kind._fields] for kind in (State, Input))
    return np.column_stack(states), np.column_stack(inputs)
