"""The last rung: brake with the friction that steering along a path leaves. SI units, ISO 8855.

Nothing here is optimised, so nothing here can fail to converge. The lateral force comes first in
the friction circle of each axle; what it leaves is for the brakes.
"""

import math
from typing import NamedTuple

from mpcc_controller.driving.target import SetPoints, Target, within_friction
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import GRAVITY, Axles, Car
from mpcc_controller.parameters import ControllerParams, Limits
from msgs_yaml.types import VehicleState

HALVINGS = 24  # of the braking force that is sought: 17 kN to 1 mN


class Point(NamedTuple):
    """A place on the road."""

    X: float  # m, map
    Y: float  # m, map


def target(
    x: VehicleState, now: SetPoints, aim: Point | None, car: Car, params: ControllerParams
) -> Target:
    """Return the set-points of one step of braking towards `aim`; without one, straight on.

    Both set-points move at their rate limits at most. A state that is not finite counts as no aim
    and no lateral motion.
    """
    limits, step_s = params.limits, params.model.step_s
    known = all(map(math.isfinite, x))
    most = params.braking.lateral_use * grip(car, limits)
    wanted = lateral_acceleration(x, aim, most) if known and aim else 0.0
    present = min(abs(x.vx * x.r), most) if known else 0.0
    push = limits.force_rate_nps * step_s
    hardest = -hardest_braking(max(abs(wanted), present), car, limits)
    Fx = min(max(hardest, now.Fx - push), now.Fx + push)
    front_share = single_track.ideal_split(Fx, car)
    front_share = min(max(front_share, limits.brake_front_share_min), limits.brake_front_share_max)
    lambda_b = within_friction(front_share, Fx, car, limits)
    turn = limits.steer_rate_radps * step_s
    delta = steering(x, wanted, Fx, lambda_b, car) if known and aim else 0.0
    delta = min(max(delta, -limits.steer_rad), limits.steer_rad)
    delta = min(max(delta, now.delta - turn), now.delta + turn)
    return Target(delta, Fx, lambda_b)


def grip(car: Car, limits: Limits) -> float:
    """Return the acceleration [m/s^2] that the usable friction of the weaker axle allows."""
    return limits.friction_use * min(car.mu_f, car.mu_r) * GRAVITY


def lateral_acceleration(x: VehicleState, aim: Point, most: float) -> float:
    """Return the lateral acceleration [m/s^2] of the arc from here to `aim`, within +-`most`.

    The arc touches the direction of motion, not the heading: a car that slides is steered by
    where it goes. Its curvature is 2 sin(angle to the aim) / distance.
    """
    dX, dY = aim.X - x.X, aim.Y - x.Y
    cos_psi, sin_psi = math.cos(x.psi), math.sin(x.psi)
    ahead, aside = cos_psi * dX + sin_psi * dY, cos_psi * dY - sin_psi * dX
    # speed^2 * curvature, with the speed of the direction's normalisation cancelled
    speed, square = math.hypot(x.vx, x.vy), ahead**2 + aside**2
    wanted = 2 * speed * (x.vx * aside - x.vy * ahead) / square if square else 0.0
    return min(max(wanted, -most), most)


def hardest_braking(lateral: float, car: Car, limits: Limits) -> float:
    """Return the largest braking force [N] beside a lateral acceleration [m/s^2] at every axle.

    It is 0 where the cornering alone takes all friction. Else every force up to the largest is
    possible, because braking unloads the rear axle, which so decides; halving finds it.
    """
    low, high = 0.0, limits.brake_n
    if not _possible(low, lateral, car, limits):
        return low
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        if _possible(middle, lateral, car, limits):
            low = middle
        else:
            high = middle
    return low


def _possible(brake, lateral, car, limits):
    Fz, Fy = single_track.loads(-brake, car), lateral_forces(lateral, car)
    share = single_track.ideal_split(-brake, car)
    share = min(max(share, limits.brake_front_share_min), limits.brake_front_share_max)
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


def steering(x: VehicleState, lateral: float, Fx: float, lambda_b: float, car: Car) -> float:
    """Return the steering angle [rad] at which the front axle gives its share of `lateral`.

    The Fiala curve, read backwards, gives the slip of that force; the direction in which the front
    axle moves is measured. So a car that yaws too much is steered against it. Below the model's
    least slip speed the angle of the arc itself, which has no slip, fades in.
    """
    F_x, F_y = single_track.split(Fx, lambda_b, car).f, lateral_forces(lateral, car).f
    Fz = single_track.loads(Fx, car).f
    capacity = math.sqrt(max((car.mu_f * Fz) ** 2 - float(F_x) ** 2, 0.0))
    use = min(abs(F_y) / capacity, 1.0) if capacity else 1.0
    slip = math.atan(3 * capacity * (1 - (1 - use) ** (1 / 3)) / car.C_f)
    fast = min(max(x.vx / car.v_slip, 0.0), 1.0)
    moving = math.atan((x.vy + car.l_f * x.r) / max(x.vx, car.v_slip))
    square = max(x.vx**2 + x.vy**2, car.v_slip**2)
    rolling = math.atan((car.l_f + car.l_r) * lateral / square)
    return fast * moving + (1 - fast) * rolling + math.copysign(slip, lateral)
