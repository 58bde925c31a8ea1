"""Recovery of a sliding car: counter-steer first, brake with the friction that is left.

A level of the fallback between plans and braking. Braking steers along a line and brakes as hard as
steady cornering allows; a car that slides has no steady cornering, and spins. Here the front wheels
are steered for the yaw moment that turns the car back into its direction of motion, as electronic
stability control brakes single wheels for it (van Zanten 2000, "Bosch ESP systems: 5 years of
experience"), and the axles brake beside the lateral forces that they give. SI units, ISO 8855.

The rear axle cannot be steered: its force F_yr follows from its slip. The steering has the front
axle left, which acts as in the control of drifts (Hindiyeh and Gerdes 2014): a rate of yaw is
demanded that reduces the sideslip, and a front force that reduces its error,

    r_d = F_yr L / (l_f m v) + k_beta (beta - beta_d),   Izz k_r (r_d - r) = l_f F_yf - l_r F_yr.

The state is that after the delay of the steering. The first term of r_d is the rate of the course
while the front axle balances the rear one, beta_d the sideslip of the cornering that leads to the
line. Nothing is optimised: it cannot fail to converge.
"""

import math

from mpcc_controller.driving import braking, setpoints
from mpcc_controller.driving.braking import Point
from mpcc_controller.driving.setpoints import Setpoints, SetpointTarget
from mpcc_controller.model import fiala, single_track
from mpcc_controller.model.single_track import Car
from mpcc_controller.parameters import ControllerParams
from msgs_yaml.types import VehicleState

LEAST_MPS = 3.0  # a slower car does not slide: it is braked
STEER_LAG_S = 0.052  # of a car whose lag is not in the model
SLIDES_RAD = 0.12  # sideslip of a car that slides
SLIDES = 0.94  # rear slip of one, share of that of full sliding
HOLDS = 0.7  # of both, below which a sliding car slides no more
K_BETA, K_R = 2.5, 9.0  # 1/s, gains of sideslip and yaw rate
LATERAL_USE = 0.5  # share of the usable friction for the way to the line
BRAKE_USE = 0.5  # of the braking force that the lateral forces leave
DELAY_S = 0.068  # from a state to the set-point that answers it; the servo comes after
SPUN_RAD = 1.2  # sideslip beyond which no steering brings the car back


def is_sliding(x: VehicleState, car: Car, slid: bool = False) -> bool:
    """Return whether the car slides too much to be braked along a line.

    It does if the sideslip angle or, for the friction of `car`, the slip angle of the rear axle is
    large; one that `slid` before until they are clearly smaller. A state that is not finite and a
    slow car do not slide.
    """
    if not all(map(math.isfinite, x)) or math.hypot(x.vx, x.vy) < LEAST_MPS:
        return False
    share = HOLDS if slid else 1.0
    full = math.atan(3 * car.mu_r * single_track.loads(0.0, car).r / car.C_r)
    return (
        abs(math.atan2(x.vy, x.vx)) > share * SLIDES_RAD
        or abs(rear_slip(x, car)) > share * SLIDES * full
    )


def rear_slip(x: VehicleState, car: Car) -> float:
    """Return the slip angle [rad] of the rear axle; at most 90 deg for a car that moves back."""
    return math.atan2(x.vy - car.l_r * x.r, max(x.vx, 0.0))


def recovery_target(
    x: VehicleState,
    now: Setpoints,
    lookahead: Point | None,
    car: Car,
    params: ControllerParams,
) -> SetpointTarget:
    """Return the set-points of one step of recovery towards `lookahead`; without one, to straight.

    Both set-points respect their limits and rate limits for every finite state.
    """
    limits, step_s = params.limits, params.model.step_s
    lag_s = car.steer_lag if params.model.servo_lag else STEER_LAG_S
    x = _predict(x, now, car, DELAY_S + lag_s)
    v = max(math.hypot(x.vx, x.vy), LEAST_MPS)
    beta = math.atan2(x.vy, x.vx)
    Fz = single_track.loads(now.Fx, car)
    most = LATERAL_USE * braking.max_acceleration(car, limits)
    lateral = braking.lateral_acceleration(x, lookahead, most) if lookahead else 0.0
    split = single_track.split(now.Fx, single_track.ideal_split(now.Fx, car), car)
    rear_capacity = braking.lateral_rest(car.mu_r * Fz.r, float(split.r))
    F_yr = _lateral_force(rear_slip(x, car), rear_capacity, car.C_r)
    wheelbase = car.l_f + car.l_r
    F_d = car.m * lateral * car.l_f / wheelbase  # of the rear axle while cornering
    beta_d = car.l_r * lateral / v**2 - braking.slip_of(F_d, car.mu_r * Fz.r, car.C_r)
    r_d = F_yr * wheelbase / (car.l_f * car.m * v) + K_BETA * (beta - beta_d)
    moment = car.Izz * K_R * (r_d - x.r)
    F_yf = (moment + car.l_r * F_yr) / car.l_f
    # the largest braking force that both axles hold beside their lateral forces
    if abs(beta) > SPUN_RAD:  # no steering brings the car back: as hard as the friction allows
        Fx = -braking.max_braking_force(0.0, car, limits)
    else:
        use, level = limits.friction_use, single_track.loads(0.0, car)
        front, rear = use * car.mu_f * level.f, use * car.mu_r * level.r
        front = braking.lateral_rest(front, min(abs(F_yf), front))
        rear = braking.lateral_rest(rear, min(abs(F_yr), rear))
        share = setpoints.allowed_split(0.0, car, limits)
        # an axle that does not brake limits nothing
        front = front / share if share > 0 else math.inf
        rear = rear / (1 - share) if share < 1 else math.inf
        Fx = -BRAKE_USE * min(front, rear, limits.brake_n)
    force_step = limits.force_rate_nps * step_s
    Fx = min(max(Fx, now.Fx - force_step), now.Fx + force_step)
    Fx = min(max(Fx, -limits.brake_n), limits.drive_n)
    lambda_b = setpoints.split_within_friction(
        setpoints.allowed_split(Fx, car, limits), Fx, car, limits
    )
    front = single_track.split(Fx, lambda_b, car).f
    capacity = braking.lateral_rest(car.mu_f * single_track.loads(Fx, car).f, float(front))
    slip = braking.slip_of(F_yf, capacity, car.C_f, car.compliance)
    delta = _front_direction(x, car) + slip
    return setpoints.within_limits(delta, Fx, lambda_b, now, limits, step_s)


def _predict(x: VehicleState, now: Setpoints, car: Car, t: float) -> VehicleState:
    """Return the state `t` [s] later under the present lateral forces (one Euler step)."""
    Fz = single_track.loads(now.Fx, car)
    slip, front = _front_direction(x, car) - now.delta, car.mu_f * Fz.f
    F_yf = _lateral_force(slip, front, car.C_f, car.compliance)
    F_yr = _lateral_force(rear_slip(x, car), car.mu_r * Fz.r, car.C_r)
    cos_psi, sin_psi = math.cos(x.psi), math.sin(x.psi)
    return x._replace(
        X=x.X + t * (x.vx * cos_psi - x.vy * sin_psi),
        Y=x.Y + t * (x.vx * sin_psi + x.vy * cos_psi),
        psi=x.psi + t * x.r,
        vx=x.vx + t * x.r * x.vy,
        vy=x.vy + t * ((F_yf + F_yr) / car.m - x.r * x.vx),
        r=x.r + t * (car.l_f * F_yf - car.l_r * F_yr) / car.Izz,
    )


def _front_direction(x, car):
    """Return the direction [rad] in which the front axle moves, from the heading."""
    return math.atan2(x.vy + car.l_f * x.r, max(x.vx, 0.0))


def _lateral_force(slip, capacity, C, compliance=0.0):
    """Return the Fiala force [N] at a slip angle [rad]; with full sliding beyond its slip."""
    if not capacity:
        return 0.0
    tan_alpha = math.tan(min(max(slip, -1.5), 1.5))
    if compliance:
        tan_alpha = float(fiala.remaining_slip(tan_alpha, capacity, C, 1.0, compliance))
    s = min(abs(C * tan_alpha / (3 * capacity)), 1.0)
    return -math.copysign(capacity * s * (3 - 3 * s + s**2), slip)
