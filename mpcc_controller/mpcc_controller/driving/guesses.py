"""Initial guesses: last plan, path, control law, ways around hazards, braking. SI units."""

import math
from collections.abc import Callable

import numpy as np

from mpcc_controller.driving import ways
from mpcc_controller.driving.braking import Point
from mpcc_controller.driving.recovery import recovery_target
from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.driving.ways import Profile, RoadAhead
from mpcc_controller.model.single_track import GRAVITY, Car, Input, State, ideal_split
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.path import arc, frenet_frame, reference_path
from mpcc_controller.path.reference_path import ReferencePath
from stage_solver.stage_problem import Plan

SLOW = 1.0  # m/s; slower, a steady cornering guess has no meaning
RETURN_TIME_S = 1.0  # at least, from an obstacle back to the path
PSI, THETA = (State._fields.index(name) for name in ('psi', 'theta'))


def from_path(path: ReferencePath, x0: State, car: Car, horizon: int, dt: float) -> Plan:
    """Return a plan along the path at the present speed that closes the offset from it.

    The offset fades linearly over the horizon; the steering angle is that of the path's curvature
    without slip. It needs no previous plan: it starts the controller and follows failures.
    """
    t = dt * np.arange(horizon + 1)
    theta = x0.theta + x0.vx * t
    arcs, _ = reference_path.arcs_at(path, theta)
    start = arc.Pose(*(field[0] for field in arc.pose_at(arcs, theta)))
    offset = arc.contouring_error(start, x0.X, x0.Y) * (1 - t / t[-1])
    zeros = np.zeros_like(t)
    X, Y, psi = frenet_frame.offset_left(arcs, offset)
    states = State(
        X=X,
        Y=Y,
        psi=psi,
        vx=zeros + x0.vx,
        vy=zeros,
        r=x0.vx * arcs.kappa,
        theta=theta,
        delta=(car.l_f + car.l_r) * arcs.kappa,
        Fx=zeros,
    )
    constant = Input(d_delta=0.0, d_Fx=0.0, lambda_b=ideal_split(0.0, car), slack=0.0)
    return start_at(Plan(np.column_stack(states), np.tile(constant, (horizon, 1))), x0)


def from_recovery(
    x0: State, path: ReferencePath, car: Car, step: Callable, params: ControllerParams
) -> Plan:
    """Return the plan that the recovery law drives in the prediction model (single shooting).

    `step` is that of `single_track.step`. The guess obeys the dynamics and the limits of the
    actuators, from any state: a car that slides is not near any plan along the path.
    """
    X, U, parameters, dt = [np.array(x0, float)], [], np.array(car), params.model.step_s
    for _ in range(params.model.horizon):
        x = State(*X[-1].tolist())
        preview = max(params.braking.preview_s * x.vx, params.braking.least_preview_m)
        arcs, _ = reference_path.arcs_at(path, x.theta + preview)
        ahead = Point(float(arcs.X), float(arcs.Y))
        target = recovery_target(x, Setpoints(x.delta, x.Fx), ahead, car, params)
        rates = (target.delta - x.delta) / dt, (target.Fx - x.Fx) / dt
        u = Input(*rates, lambda_b=target.lambda_b, slack=0.0)
        U.append(np.array(u, float))
        X.append(step(X[-1], U[-1], parameters))
    return Plan(np.array(X), np.array(U))


def start_at(plan: Plan, x0: State) -> Plan:
    """Return the plan with `x0` as its first state, theta and turns of psi counted from x0.

    theta is projected on the path at every tick: the theta of the whole plan moves with it. The
    heading of x0 is within pi of the path's: where that begins with another whole turn, as on a new
    path to the west may be, the plan turns with it.
    """
    X = np.array(plan.X)
    X[:, THETA] += x0.theta - X[0, THETA]
    turns = np.round((x0.psi - X[0, PSI]) / (2 * np.pi))
    if turns:
        X[:, PSI] += 2 * np.pi * turns
    X[0] = x0
    return plan._replace(X=X)


def along_profile(
    around: RoadAhead, shape: Profile, x0: State, car: Car, params: ControllerParams
) -> Plan:
    """Return the guess that takes the offsets of a profile on the way to the desired speed.

    Quintics lead from offset to offset and back to the path. Heading, yaw rate, sideslip and
    steering angle are those of steady cornering along the line, within the friction.
    """
    t = params.model.step_s * np.arange(len(around.left))
    start, rate = ways.lateral_motion(around, x0)
    e = np.full(len(t), start)
    time, here = 0.0, start
    last = shape.slots[-1]
    back = math.sqrt(ways.QUINTIC_PEAK * abs(last.offset) / (0.4 * GRAVITY))
    knots = [(slot.enter, slot.leave, slot.offset) for slot in shape.slots]
    knots.append((last.leave + max(back, RETURN_TIME_S), math.inf, 0.0))
    for begin, leave, target in knots:
        T = max(begin - time, ways.LEAST_TIME_S)
        later = t >= time
        # the quintic of tau in [0, 1] to rest at the target; both ends have no acceleration
        tau = np.minimum((t[later] - time) / T, 1.0)
        slope, rise = rate * T, target - here
        cubic = 10 * rise - 6 * slope
        quartic, quintic = 8 * slope - 15 * rise, 6 * rise - 3 * slope
        e[later] = here + tau * (slope + tau**2 * (cubic + tau * (quartic + tau * quintic)))
        time, here, rate = max(leave, time + T), target, 0.0
    arcs = around.arcs
    X, Y, _ = frenet_frame.offset_left(arcs, e)
    along = np.maximum(around.vx, SLOW) * (1 - arcs.kappa * e)
    course = arcs.psi + np.arctan2(np.gradient(e, t), along)
    force = car.m * np.gradient(around.vx, params.model.step_s)
    force = np.clip(force, -params.limits.brake_n, params.limits.drive_n)
    return _steady_plan(X, Y, course, around.vx, force, arcs.theta, x0, car, params)


def braking(
    line: np.ndarray, x0: State, car: Car, params: ControllerParams, floor: float | None = None
) -> Plan:
    """Return the guess that brakes along planned states `line` (N + 1, 9), at most to the floor.

    It brakes with the usable friction that the curvature of the line leaves, from the present force
    at the rate limit, behind which the brakes lag. Below the floor [m/s], by default
    `limits.least_speed_mps`, the prediction holds no more.
    """
    available = params.limits.friction_use * min(car.mu_f, car.mu_r) * GRAVITY
    lateral = min(float(np.max(np.abs(line[:, 5] * line[:, 3]))), 0.8 * available)
    deceleration = math.sqrt(available**2 - lateral**2)
    floor = min(params.limits.least_speed_mps if floor is None else floor, x0.vx)
    # The prediction model brakes straight on: the force goes to that of the deceleration at its
    # rate limit. The resistances are left out: what is promised is to be kept.
    dt, limits = params.model.step_s, params.limits
    hardest = -min(car.m * deceleration, limits.brake_n)
    change = limits.force_rate_nps * dt * np.arange(len(line))
    force = x0.Fx + np.clip(hardest - x0.Fx, -change, change)
    # what acts in each step, see `single_track.acting`
    acting = (force[1:] + force[:-1]) / 2 - car.force_lag * np.diff(force) / dt
    gained = np.concatenate(([0.0], np.cumsum(acting))) * dt / car.m
    vx = np.maximum(x0.vx + gained, floor)
    force = np.where(vx > floor, force, 0.0)
    distance = ways.travelled(vx, dt)
    along = line[:, THETA] - line[0, THETA]
    along = np.maximum.accumulate(along + 1e-9 * np.arange(len(along)))
    beyond = np.maximum(distance - along[-1], 0)
    X, Y, psi = (np.interp(distance, along, line[:, i]) for i in range(3))
    X, Y = X + beyond * np.cos(psi), Y + beyond * np.sin(psi)
    return _steady_plan(X, Y, psi, vx, force, x0.theta + distance, x0, car, params)


def _steady_plan(X, Y, course, vx, Fx, theta, x0, car, params) -> Plan:
    """Return the plan of steady cornering along a line of positions and courses.

    Where it stands or is slower than SLOW it corners as at that speed.
    """
    dt = params.model.step_s
    v = np.maximum(vx, SLOW)
    available = 0.9 * min(car.mu_f, car.mu_r) * GRAVITY
    r = np.clip(np.gradient(course, dt), -available / v, available / v)
    wheelbase, ay = car.l_f + car.l_r, v * r
    front = car.m * ay * car.l_r / wheelbase
    slip_f = front / car.C_f + car.compliance * front
    slip_r = car.m * ay * car.l_f / wheelbase / car.C_r
    vy = car.l_r * r - v * slip_r
    delta = wheelbase * r / v + slip_f - slip_r
    states = State(
        X=X,
        Y=Y,
        psi=course - vy / v,
        vx=vx,
        vy=vy,
        r=r,
        theta=theta,
        delta=np.clip(delta, -params.limits.steer_rad, params.limits.steer_rad),
        Fx=Fx,
    )
    constant = Input(d_delta=0.0, d_Fx=0.0, lambda_b=ideal_split(0.0, car), slack=0.0)
    U = np.tile(constant, (len(X) - 1, 1))
    rate, force_rate = params.limits.steer_rate_radps, params.limits.force_rate_nps
    U[:, 0] = np.clip(np.diff(states.delta) / dt, -rate, rate)
    U[:, 1] = np.clip(np.diff(Fx) / dt, -force_rate, force_rate)
    return start_at(Plan(np.column_stack(states), U), x0)
