"""Everything one tick has to say about itself, as the values of /controller/why."""

from collections import Counter
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving.ladder import BRAKING, Decision
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, Input, State
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.path import distance, path_distance, path_frame, road
from mpcc_controller.path.distance import Disc
from mpcc_controller.path.path_distance import PathDisc
from mpcc_controller.path.path_frame import Place
from mpcc_controller.problem.insight import View
from mpcc_controller.problem.stages import Numbers, Scene
from msgs_yaml.types import Command, Obstacle, Prediction, VehicleState, Why
from stage_solver.solution import SOLVED, Solution
from stage_solver.stage_problem import Plan

OK, WARN, ERROR = 0, 1, 2  # diagnostic_msgs


class Arrival(NamedTuple):
    """How the state of a tick came."""

    heard_ns: int  # wall time; its sender's is kept by the middleware, and so by bags
    wait_s: float  # from then to the beginning of the step: for other inputs


def arrived(arrival: Arrival | None) -> dict:
    """Return how the state came, nothing where that is not known."""
    if arrival is None:
        return {}
    return {'time.heard_ns': arrival.heard_ns, 'time.wait_ms': 1e3 * arrival.wait_s}


def times(lead_s: float, publish_s: float | None, ahead_s: float | None) -> dict:
    """Return how late the command acts, what sending the one before took, and preparing this."""
    known = {'lead': lead_s, 'publish': publish_s, 'ahead': ahead_s}
    return {f'time.{name}_ms': 1e3 * took for name, took in known.items() if took is not None}


def tick(stamp_ns: int, decision: Decision, gate: str, values: dict) -> Why:
    """Return the `Why` of a tick; `gate` is the reason for which the gate intervened, or ''.

    What has no value, as the cost of a solve that did not begin, is left out.
    """
    level = {SOLVED: OK, BRAKING: ERROR}.get(decision.rung, WARN)
    told = f'{decision.rung}: {decision.reason}'
    if gate:
        level, told = ERROR, f'{told}; gate: {gate}'
    named = {'rung': decision.rung, 'reason': decision.reason, 'gate': gate or 'passed'}
    values = {name: value for name, value in values.items() if value == value}  # NaN does not
    return Why(stamp_ns, level, told, named | values)


def prediction(x: VehicleState, plan: Plan | None, step_s: float) -> Prediction:
    """Return the planned poses; without a plan the present one, none when that is unknown."""
    if plan is not None:
        states = State(*plan.X.T)
        t = step_s * np.arange(len(plan.X))
        return Prediction(x.stamp_ns, states.X, states.Y, states.psi, t)
    here = np.array([(x.X, x.Y, x.psi)] if np.all(np.isfinite(x)) else np.empty((0, 3)))
    return Prediction(x.stamp_ns, *here.T, np.zeros(len(here)))


def measured(x: State) -> dict:
    """Return where the car is on its path and what its actuators were last told."""
    return {
        'theta': float(x.theta),
        'vx': float(x.vx),
        'set_point.delta': float(x.delta),
        'set_point.Fx': float(x.Fx),
    }


def commanded(command: Command, car: Car, rejections: Counter) -> dict:
    """Return the brake split that leaves (0 while not braking), the ideal one, and the refusals."""
    force = command.Fxf + command.Fxr
    return {
        'split.front': command.Fxf / force if force < 0 else 0.0,
        'split.ideal': float(single_track.ideal_split(force, car)),
        'gate.rejections': sum(rejections.values()),
        **{f'gate.{reason}': count for reason, count in sorted(rejections.items())},
    }


def solved(first: Solution, second: Solution | None, prepare_s: float, warm: bool) -> dict:
    """Return how the solvers fared; the second one's time counts like the first one's."""
    said = {
        'solver.warm': warm,
        **_fared('solver', first),
        'time.prepare_ms': 1e3 * prepare_s,
        'time.solve_ms': 1e3 * first.solve_s,
        'time.solve_cpu_ms': 1e3 * first.cpu_s,
    }
    if second is not None:
        said |= _fared('fallback', second)
        said['time.fallback_ms'] = 1e3 * second.solve_s
        said['time.solve_ms'] += said['time.fallback_ms']
        said['time.solve_cpu_ms'] += 1e3 * second.cpu_s
    return said


def _fared(name, solution):
    return {
        f'{name}.status': solution.status,
        f'{name}.message': solution.message,
        f'{name}.iterations': solution.iterations,
        f'{name}.primal_residual': solution.primal_residual,
        f'{name}.dual_residual': solution.dual_residual,
        f'{name}.cost': solution.cost,
    }


def surroundings(
    x: State, scene: Scene, obstacles: tuple[Obstacle, ...], params: ControllerParams
) -> dict:
    """Return the distances at this instant, to obstacles also in path coordinates.

    Each is that of the nearest of the vehicle's circles; the difference is positive where path
    coordinates see more room than there is.
    """
    radius = params.body.circle_radius_m
    circles = [distance.circle(x, offset, radius) for offset in params.body.circle_offsets_m]
    places = _places(scene.path, circles, x.theta)
    said = {}
    for one, place in zip(obstacles, _places(scene.path, obstacles, x.theta)):
        disc = Disc(one.X, one.Y, one.r_obs)
        beside = PathDisc(place.s, place.e, one.r_obs)
        straight = min(float(distance.v2o(c, disc)) for c in circles)
        along = min(float(path_distance.v2o(vehicle, radius, beside)) for vehicle in places)
        said[f'v2o.{one.id}'] = straight
        said[f'v2o_frenet.{one.id}'] = along
        said[f'v2o_difference.{one.id}'] = along - straight
    here = (np.array([value]) for value in (x.X, x.Y))
    edges = road.near_plan(scene.road, *here, params.surroundings.edge_window_m)
    for side, *gaps in zip(('left', 'right'), *(distance.v2e(c, edges) for c in circles)):
        said[f'v2e.{side}'] = float(min(gap[0] for gap in gaps))
    return said


def _places(path, points, near):
    """Return where each point of the map is along the path; of several places that nearest."""
    X, Y = (np.array([getattr(point, axis) for point in points], float) for axis in 'XY')
    found = path_frame.places(path, X, Y, near)
    return [Place(float(s), float(e)) for s, e in zip(found.s, found.e)]


def planned(view: View, numbers: Numbers, U: np.ndarray) -> dict:
    """Return the plan's cost by term, its distances and priorities, its use of the friction."""
    terms = {name: float(np.sum(term)) for name, term in view.terms._asdict().items()}
    weights = {name: float(weight) for name, weight in numbers.stages.weights._asdict().items()}
    slack = U[:, Input._fields.index('slack')]
    said = {'cost.total': sum(terms.values())}
    said |= {f'cost.{name}': term for name, term in terms.items()}
    said |= {f'weight.{name}': weight for name, weight in weights.items()}
    for obstacle, D, q in zip(numbers.obstacles, view.v2o, view.priority_o):
        said |= _distance(f'v2o.{obstacle.id}', f'q_v2o.{obstacle.id}', D, q, weights['v2o'])
    for side, D, q in zip(('left', 'right'), view.v2e, view.priority_e):
        said |= _distance(f'v2e.{side}', f'q_v2e.{side}', D, q, weights['v2e'])
    for error, e in view.tracking._asdict().items():
        said |= {f'error.{error}': float(e[0]), f'error.{error}_max': float(np.max(np.abs(e)))}
    return said | {
        'friction.front': float(view.friction.f[0]),
        'friction.rear': float(view.friction.r[0]),
        'friction.front_max': float(np.max(view.friction.f)),
        'friction.rear_max': float(np.max(view.friction.r)),
        'slack.max': float(np.max(np.abs(slack))),
        'v_ref': float(numbers.stages.v_ref[0]),
    }


def _distance(name, weight_name, D, q, P_k):
    """Return the least distance of the plan, the weight in force now and the largest to come."""
    return {
        f'{name}.least': float(np.min(D)),
        weight_name: float(P_k * np.max(q)),
        f'{weight_name}.now': float(P_k * q[0]),
    }
