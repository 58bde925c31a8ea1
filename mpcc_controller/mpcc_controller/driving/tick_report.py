"""Explains a tick: the values of /controller/why and the planned poses, from a `TickRecord`."""

from collections.abc import Mapping, Sequence

import numpy as np

from mpcc_controller.driving import ways
from mpcc_controller.driving.actuator_faults import FAULT
from mpcc_controller.driving.fallback import BRAKING, RECOVERY
from mpcc_controller.driving.parts import Parts
from mpcc_controller.driving.records import Attempt, TickRecord
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Input, State
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.path import distance, frenet_frame, road_edges
from mpcc_controller.path.distance import Circle, Disc
from mpcc_controller.path.frenet_frame import FrenetPoint
from mpcc_controller.problem import stage_parameters
from mpcc_controller.problem.obstacle_motion import PredictedObstacle
from mpcc_controller.problem.ocp import PlanValues
from mpcc_controller.problem.stage_parameters import Scene, StageParameters
from mpcc_controller.run_time_parameters import REPORTED
from msgs_yaml.conversions import ns_to_s
from msgs_yaml.types import Prediction, Why
from stage_solver.solution import SOLVED

OK, WARN, ERROR = 0, 1, 2  # diagnostic_msgs
RESUMED = 'resumed'  # in the report of the first step after a pause
LEFT_OUT = 'obstacles.left_out'
ACTUATORS_AGE = 'actuators.age_ms'  # of the message that was compared
LINE_STAGES = 5  # of a candidate's plan one stage in this many is reported


class TickReporter:
    """Explains the ticks of one controller; `changes` of its parameters are reported."""

    def __init__(self, parts: Parts):
        self._parts = parts
        self.changes: Mapping[str, float] = {}  # since the start, by name

    def prediction(self, record: TickRecord) -> Prediction:
        """Return the planned poses; without a plan the present one, none if that is unknown."""
        x, plan = record.state, record.decision.plan
        if plan is not None:
            states = State(*plan.X.T)
            t = self._parts.params.model.step_s * np.arange(len(plan.X))
            return Prediction(x.stamp_ns, states.X, states.Y, states.psi, t)
        poses = np.array([(x.X, x.Y, x.psi)] if np.all(np.isfinite(x)) else np.empty((0, 3)))
        return Prediction(x.stamp_ns, *poses.T, np.zeros(len(poses)))

    def why(self, record: TickRecord, plan_values: bool = True) -> Why:
        """Return level, message and values of a tick; values of NaN are left out.

        Without `plan_values` distances, and what is evaluated from the plan, are left out: they
        take longer to compute than all others.
        """
        decision, gate = record.decision, record.gate_reason
        level = {SOLVED: OK, RECOVERY: ERROR, BRAKING: ERROR}.get(decision.level, WARN)
        message = f'{decision.level}: {decision.reason}'
        if gate:
            level, message = ERROR, f'{message}; gate: {gate}'
        values = {'rung': decision.level, 'reason': decision.reason, 'gate': gate or 'passed'}
        values |= {name: v for name, v in self._values(record, plan_values).items() if v == v}
        return Why(record.inputs.state.stamp_ns, level, message, values)

    def _values(self, record: TickRecord, plan_values: bool) -> dict:
        x0, inputs, command = record.x0, record.inputs, record.command
        values: dict = {}
        if x0 is not None:  # path distance, speed and set-points at stage 0
            values['theta'], values['vx'] = float(x0.theta), float(x0.vx)
            values['set_point.delta'], values['set_point.Fx'] = float(x0.delta), float(x0.Fx)
            if record.attempt is not None:
                values |= _solutions(record.attempt)
            if plan_values:
                values |= self._plan_values(record)
        if record.friction is not None:
            values['friction.estimate'] = record.friction.friction
            values['friction.excitation'] = record.friction.excitation
        if record.braking_line is not None:
            values['guide'] = record.braking_line
        # the commanded brake split (0 without braking), and the ideal one
        force = command.Fxf + command.Fxr
        values['split.front'] = command.Fxf / force if force < 0 else 0.0
        values['split.ideal'] = float(single_track.ideal_split(force, self._parts.model.car))
        values['gate.rejections'] = sum(record.rejections.values())
        values |= {f'gate.{reason}': n for reason, n in sorted(record.rejections.items())}
        # how far the actuators are beyond their set-points, and which do not follow them
        check = record.actuators
        if check is not None and check.age_s is not None:
            values[ACTUATORS_AGE] = 1e3 * check.age_s
            values['actuators.steer_error_rad'] = check.steer_error
            values['actuators.force_error_n'] = check.force_error
        if check is not None and check.faults:
            values[FAULT] = '+'.join(check.faults)
        if check is not None and check.late_ns:
            values['actuators.late_ms'] = 1e3 * ns_to_s(check.late_ns)
        if record.resumed:
            values[RESUMED] = True
        # obstacles that the problem has no room for
        if record.attempt is not None:
            placed = record.attempt.problem.parameters
            missing = stage_parameters.left_out(record.scene.obstacles, placed)
            values |= {LEFT_OUT: missing} if missing else {}
        values['time.lead_ms'] = 1e3 * ns_to_s(record.effective_ns - inputs.state.stamp_ns)
        if inputs.publish_s is not None:
            values['time.publish_ms'] = 1e3 * inputs.publish_s
        if record.prepared_s is not None:
            values['time.ahead_ms'] = 1e3 * record.prepared_s
        if inputs.received_ns is not None:
            values['time.heard_ns'] = inputs.received_ns
            values['time.wait_ms'] = 1e3 * inputs.wait_s
        return values | {REPORTED + name: value for name, value in self.changes.items()}

    def _plan_values(self, record: TickRecord) -> dict:
        attempt, params, model = record.attempt, self._parts.params, self._parts.model
        if attempt is None:
            known = record.scene.obstacles.items
            rows = stage_parameters.closest_discs(params, known, np.array([record.x0]))
            near = [known[row] for row in rows]
            return distances_now(record.x0, record.scene, near, params)
        parameters, scene = attempt.problem.parameters, attempt.problem.scene
        values = distances_now(attempt.problem.x0, scene, parameters.obstacles, params)
        if attempt.plan is not None:
            plan = model.formulation.to_local(attempt.plan, scene.path)
            evaluated = model.evaluator.evaluate(plan, parameters.P)
            values |= _planned(evaluated, parameters, attempt.plan.U)
        # the lines of the candidates that may be driven, one text each, for viewers
        outcomes = attempt.choice.outcomes if attempt.choice else ()
        for number, outcome in enumerate(outcomes):
            if outcome.is_usable:
                points = outcome.solution.plan.X[::LINE_STAGES, :2]
                line = ' '.join(f'{X:.2f},{Y:.2f}' for X, Y in points)
                values[f'candidates.{number}.line'] = line
        return values


def _solutions(attempt: Attempt) -> dict:
    """Return status and times of the solver; `solve_ms` is the time of all solves together."""
    solution = attempt.solution
    values = {
        'solver.warm': attempt.warm,
        'solver.status': solution.status,
        'solver.message': solution.message,
        'solver.iterations': solution.iterations,
        'solver.primal_residual': solution.primal_residual,
        'solver.dual_residual': solution.dual_residual,
        'solver.cost': solution.cost,
        'time.prepare_ms': 1e3 * attempt.prepare_s,
        'time.solve_ms': 1e3 * attempt.solve_s,
        'time.solve_cpu_ms': 1e3 * solution.cpu_s,
        'plan.age': attempt.plan_age,
        'plan.failures': attempt.failures,
    }
    if attempt.refreshes is not None:
        values['solver.refreshes'] = attempt.refreshes
    if attempt.choice is None:
        return values
    outcomes, chosen, switched = attempt.choice
    values['time.solve_cpu_ms'] = 1e3 * sum(outcome.solution.cpu_s for outcome in outcomes)
    values['candidates.count'] = len(outcomes)
    values['candidates.chosen'], values['candidates.switched'] = chosen, switched
    for number, outcome in enumerate(outcomes):
        solution, key = outcome.solution, f'candidates.{number}'
        values |= {
            f'{key}.name': outcome.name,
            f'{key}.status': outcome.rejection or solution.status,
            f'{key}.cost': solution.cost,
            f'{key}.iterations': solution.iterations,
            f'{key}.cpu_ms': 1e3 * solution.cpu_s,
            f'{key}.clean': outcome.is_clean(),
            f'{key}.way': ways.name_of(outcome.sides) or 'none',
        }
        if np.isfinite(outcome.least_gap):
            values[f'{key}.v2o_least'] = outcome.least_gap
    return values


def distances_now(
    x: State, scene: Scene, obstacles: Sequence[PredictedObstacle], params: ControllerParams
) -> dict:
    """Return the distances at this instant, to obstacles also in path coordinates.

    Each is that of the closest vehicle circle, of several circles that of each of them, too, and of
    the closest disc. The
    difference is positive where path coordinates overestimate the distance.
    """
    radius = params.body.circle_radius_m
    circles = [distance.circle(x, offset, radius) for offset in params.body.circle_offsets_m]
    circle_points = _to_frenet(scene.path, circles, x.theta)
    values = {}
    for obstacle, point in zip(obstacles, _to_frenet(scene.path, obstacles, x.theta)):
        disc = Disc(obstacle.X, obstacle.Y, obstacle.r_obs)
        frenet_disc = Disc(*point, obstacle.r_obs)
        gaps = [float(distance.v2o(c, disc)) for c in circles]
        cartesian = min(gaps)
        if cartesian >= values.get(f'v2o.{obstacle.id}', np.inf):
            continue  # another disc of it is closer
        frenet = min(float(distance.v2o(Circle(*c, radius), frenet_disc)) for c in circle_points)
        values[f'v2o.{obstacle.id}'] = cartesian
        values[f'v2o_frenet.{obstacle.id}'] = frenet
        values[f'v2o_difference.{obstacle.id}'] = frenet - cartesian
        values |= _per_circle(f'v2o.{obstacle.id}', gaps)
    X, Y = np.array([x.X]), np.array([x.Y])
    edges = road_edges.edges_near(scene.road, X, Y, params.surroundings.edge_window_m)
    if params.body.edge_radius_m is not None:
        circles = [c._replace(r=params.body.edge_radius_m) for c in circles]
    for side, *gaps in zip(('left', 'right'), *(distance.v2e(c, edges) for c in circles)):
        gaps = [float(gap[0]) for gap in gaps]
        values[f'v2e.{side}'] = min(gaps)
        values |= _per_circle(f'v2e.{side}', gaps)
    return values


def _per_circle(name, gaps):
    """Return the distance of each circle, counted from 1 at the rear, where there are several."""
    numbered = enumerate(gaps, 1) if len(gaps) > 1 else ()
    return {f'{name}.circle_{number}': gap for number, gap in numbered}


def _to_frenet(path, points, near):
    """Return points with X and Y in path coordinates; of several solutions that closest to near."""
    X, Y = (np.array([getattr(point, axis) for point in points], float) for axis in 'XY')
    frenet = frenet_frame.to_frenet(path, X, Y, near)
    return [FrenetPoint(float(s), float(e)) for s, e in zip(frenet.s, frenet.e)]


def _planned(evaluated: PlanValues, parameters: StageParameters, U: np.ndarray) -> dict:
    """Return the plan's cost by term, its distances and weights, its use of the friction."""
    costs = {name: float(np.sum(cost)) for name, cost in evaluated.costs._asdict().items()}
    weights = {name: float(w) for name, w in parameters.stages.weights._asdict().items()}
    slack = U[:, Input._fields.index('slack')]
    values = {'cost.total': sum(costs.values())}
    values |= {f'cost.{name}': cost for name, cost in costs.items()}
    values |= {f'weight.{name}': weight for name, weight in weights.items()}
    slots = evaluated.v2o, evaluated.priority_o
    for key, D, q in stage_parameters.by_object(parameters, *slots):
        values |= _distance(f'v2o.{key}', D, q, weights['v2o'])
    for side, D, q in zip(('left', 'right'), evaluated.v2e, evaluated.priority_e):
        values |= _distance(f'v2e.{side}', D, q, weights['v2e'])
    for name, e in evaluated.tracking._asdict().items():
        values |= {f'error.{name}': float(e[0]), f'error.{name}_max': float(np.max(np.abs(e)))}
    return values | {
        'friction.front': float(evaluated.friction.f[0]),
        'friction.rear': float(evaluated.friction.r[0]),
        'friction.front_max': float(np.max(evaluated.friction.f)),
        'friction.rear_max': float(np.max(evaluated.friction.r)),
        'slack.max': float(np.max(np.abs(slack))),
        'v_ref': float(parameters.stages.v_ref[0]),
    }


def _distance(name, D, q, P_k):
    """Return the least distance of the plan, the largest weight in force and that of now."""
    return {
        f'{name}.least': float(np.min(D)),
        f'q_{name}': float(P_k * np.max(q)),
        f'q_{name}.now': float(P_k * q[0]),
    }
