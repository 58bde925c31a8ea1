"""Fallback braking: brake along a line with the friction that steering leaves. SI units, ISO 8855.

Nothing here is optimised, so nothing here can fail to converge. In the friction circle of each axle
the lateral force comes first, the brakes get the rest. The line is the last good plan or the path.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving import setpoints
from mpcc_controller.driving.setpoints import Setpoints, SetpointTarget
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import GRAVITY, Axles, Car, State
from mpcc_controller.parameters import Braking, ControllerParams, Limits
from mpcc_controller.path import reference_path
from mpcc_controller.path.reference_path import ReferencePath
from msgs_yaml.types import VehicleState
from stage_solver.stage_problem import Plan

BISECTIONS = 24  # of the braking force: 17 kN to 1 mN
PLAN, PATH, NONE = 'plan', 'path', 'none'  # lines to steer along


class Point(NamedTuple):
    """A point of the road."""

    X: float  # m, map
    Y: float  # m, map


def braking_target(
    x: VehicleState,
    now: Setpoints,
    lookahead: Point | None,
    car: Car,
    params: ControllerParams,
    steers: bool = True,
) -> SetpointTarget:
    """Return the set-points of one step of braking towards `lookahead`; without one, straight on.

    Both set-points respect their rate limits. With a state that is not finite the car brakes
    straight on, as without lateral motion. The brakes of a car that does not steer when asked to
    (`steers`) get all friction: what they take of it straightens its course. Where the line bends
    further than the car does, they leave what it needs to go on as it does.
    """
    limits, step_s = params.limits, params.model.step_s
    known = all(map(math.isfinite, x))
    max_lateral = params.braking.lateral_use * max_acceleration(car, limits)
    lateral = lateral_acceleration(x, lookahead, max_lateral) if known and lookahead else 0.0
    present = min(abs(x.vx * x.r), max_lateral) if known else 0.0
    force_step = limits.force_rate_nps * step_s
    reserved = max(abs(lateral), present)
    if not steers and lateral * x.r > 0 and abs(lateral) > present:
        reserved = present
    elif not steers:
        reserved, limits = 0.0, replace(limits, friction_use=1.0)
    Fx = -max_braking_force(reserved, car, limits)
    Fx = min(max(Fx, now.Fx - force_step), now.Fx + force_step)
    lambda_b = setpoints.split_within_friction(
        setpoints.allowed_split(Fx, car, limits), Fx, car, limits
    )
    delta = steering_angle(x, lateral, Fx, lambda_b, car) if known and lookahead else 0.0
    return setpoints.within_limits(delta, Fx, lambda_b, now, limits, step_s)


def max_acceleration(car: Car, limits: Limits) -> float:
    """Return the acceleration [m/s^2] that the usable friction of the weaker axle allows."""
    return limits.friction_use * min(car.mu_f, car.mu_r) * GRAVITY


def lateral_acceleration(x: VehicleState, lookahead: Point, limit: float) -> float:
    """Return the lateral acceleration [m/s^2] of the arc to `lookahead`, within +-`limit`.

    The arc is tangent to the velocity, not to the heading, so that a sliding car is steered by
    where it moves. Its curvature is 2 sin(angle to the point) / distance (pure pursuit).
    """
    dX, dY = lookahead.X - x.X, lookahead.Y - x.Y
    cos_psi, sin_psi = math.cos(x.psi), math.sin(x.psi)
    ahead, aside = cos_psi * dX + sin_psi * dY, cos_psi * dY - sin_psi * dX
    # speed^2 * curvature, with the speed of the direction's normalisation cancelled
    speed, square = math.hypot(x.vx, x.vy), ahead**2 + aside**2
    lateral = 2 * speed * (x.vx * aside - x.vy * ahead) / square if square else 0.0
    return min(max(lateral, -limit), limit)


def max_braking_force(lateral: float, car: Car, limits: Limits) -> float:
    """Return the largest braking force [N] that both axles hold beside a lateral acceleration.

    `lateral` is in m/s^2. The force is 0 where cornering alone takes all friction. Otherwise every
    force up to the largest is feasible, because braking unloads the rear axle, which decides; the
    largest is found by bisection.
    """
    low, high = 0.0, limits.brake_n
    if not _is_feasible(low, lateral, car, limits):
        return low
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        if _is_feasible(middle, lateral, car, limits):
            low = middle
        else:
            high = middle
    return low


def _is_feasible(brake, lateral, car, limits):
    Fz, Fy = single_track.loads(-brake, car), lateral_forces(lateral, car)
    share = setpoints.allowed_split(-brake, car, limits)
    front = math.hypot(share * brake, Fy.f) <= limits.friction_use * car.mu_f * Fz.f
    rear = math.hypot((1 - share) * brake, Fy.r) <= limits.friction_use * car.mu_r * Fz.r
    return front and rear


def lateral_forces(lateral: float, car: Car) -> Axles:
    """Return the lateral force [N] per axle of steady cornering at an acceleration [m/s^2]."""
    wheelbase = car.l_f + car.l_r
    return Axles(
        f=car.m * lateral * car.l_r / wheelbase,
        r=car.m * lateral * car.l_f / wheelbase,
    )


def steering_angle(x: VehicleState, lateral: float, Fx: float, lambda_b: float, car: Car) -> float:
    """Return the steering angle [rad] at which the front axle gives its share of `lateral`.

    The inverse Fiala curve gives the slip angle of that force; the direction in which the front
    axle moves follows from the measured state. A car that yaws too much is thus counter-steered.
    Below `v_slip` of the model the kinematic angle of the arc fades in.
    """
    F_x, F_y = single_track.split(Fx, lambda_b, car).f, lateral_forces(lateral, car).f
    Fz = single_track.loads(Fx, car).f
    slip = slip_of(F_y, lateral_rest(car.mu_f * Fz, float(F_x)), car.C_f, car.compliance)
    blend = min(max(x.vx / car.v_slip, 0.0), 1.0)
    direction = math.atan((x.vy + car.l_f * x.r) / max(x.vx, car.v_slip))
    square = max(x.vx**2 + x.vy**2, car.v_slip**2)
    kinematic = math.atan((car.l_f + car.l_r) * lateral / square)
    return blend * direction + (1 - blend) * kinematic + slip


def lateral_rest(friction: float, Fx: float) -> float:
    """Return the lateral force [N] that is left of a friction force beside a longitudinal one."""
    return math.sqrt(max(friction**2 - Fx**2, 0.0))


def slip_of(F: float, capacity: float, C: float, compliance: float = 0.0) -> float:
    """Return the angle [rad] by which a wheel is turned from its motion to give a lateral force.

    The inverse Fiala curve of the cornering stiffness `C` [N/rad], and what the wheel gives way by
    `compliance` [rad/N]; a force beyond the capacity gets the slip of the peak.
    """
    use = min(abs(F) / capacity, 1.0) if capacity else 1.0
    slip = math.atan(3 * capacity * (1 - (1 - use) ** (1 / 3)) / C)
    return math.copysign(slip + compliance * use * capacity, F)


def lookahead_point(
    x: VehicleState,
    plan: Plan | None,
    path: ReferencePath | None,
    theta: float | None,
    params: Braking,
) -> tuple[str, Point | None]:
    """Return a line, and its point ahead of the car: of the plan, without one of the path.

    The line is PLAN, PATH or NONE. `theta` is the path distance [m] of the car. A state that is not
    finite has no such point.
    """
    if not np.all(np.isfinite(x)):
        return NONE, None
    preview = max(params.preview_s * x.vx, params.least_preview_m)
    if plan is not None:
        states = State(*plan.X.T)
        line = np.column_stack((states.X, states.Y))
        return PLAN, point_ahead(line, x.X, x.Y, preview)
    if path is not None:
        arcs, _ = reference_path.arcs_at(path, theta + preview)
        return PATH, Point(float(arcs.X), float(arcs.Y))
    return NONE, None


def point_ahead(line: np.ndarray, X: float, Y: float, distance: float) -> Point:
    """Return the point `distance` [m] along a polyline (n, 2) after the foot of (X, Y) on it.

    The line continues straight past its end.
    """
    chords = np.diff(line, axis=0)
    lengths = np.hypot(*chords.T)
    chords, starts = chords[lengths > 0], line[:-1][lengths > 0]
    lengths = lengths[lengths > 0]
    if not len(lengths):
        return Point(*map(float, line[-1]))
    directions = chords / lengths[:, None]
    along = np.clip(np.sum((np.array((X, Y)) - starts) * directions, axis=1), 0, lengths)
    offsets = starts + along[:, None] * directions - (X, Y)
    nearest = np.argmin(np.sum(offsets**2, axis=1))
    before = np.concatenate(([0], np.cumsum(lengths)))
    s = before[nearest] + along[nearest] + distance
    k = min(np.searchsorted(before, s, side='right'), len(lengths)) - 1
    return Point(*map(float, starts[k] + (s - before[k]) * directions[k]))
