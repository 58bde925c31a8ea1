"""Suspension: vertical dynamics of body, wheels and tyres; roll and compliance steer.

A sprung body with heave, roll and pitch stands on four unsprung masses and tyres. Springs, dampers
and anti-roll bars act between body and wheel. The links carry part of the tyre forces past the
springs: the instant centres of a wheel lie on the lines from its contact patch to the roll centre
and to the pitch centre (Milliken, Race Car Vehicle Dynamics, ch. 17). The contact patch moves with
the same ratios, so the links do no work. All forces are differences to standstill.

Roll steer and compliance steer are linear, per axle, and positive for understeer: a front wheel
turns out of the curve, a rear wheel into it. Compliance steer follows the lateral tyre force, which
lags behind slip by the relaxation length, so there is no algebraic loop. Angles [rad], left
positive; forces [N].
"""

from typing import Any, NamedTuple

import casadi as ca


class Corner(NamedTuple):
    """Position and suspension of a wheel."""

    axle: Any  # car.Axle
    x: Any  # m from the CoG, forward
    y: Any  # m, left
    side: int  # 1 left, -1 right
    roll_ratio: Any  # -, lateral over vertical motion of the contact patch
    pitch_ratio: Any  # -, longitudinal over vertical motion
    Fz_static: Any  # N


def wheel_corners(p) -> tuple[Corner, ...]:
    """Return the four corners of a `car.Car`, in the order of WHEELS."""
    body, axles = p.body, p.suspension
    wheelbase = body.cog_to_front_m + body.cog_to_rear_m
    weight = body.mass_kg * body.gravity_mps2
    corners = []
    for axle, x in ((axles.front, body.cog_to_front_m), (axles.rear, -body.cog_to_rear_m)):
        for side in (1, -1):
            y = side * axle.track_m / 2
            ratios = axle.roll_centre_height_m / y, axle.pitch_centre_height_m / x
            Fz_static = weight * (wheelbase - ca.fabs(x)) / wheelbase / 2
            corners.append(Corner(axle, x, y, side, *ratios, Fz_static))
    return tuple(corners)


def travel(ride, wheel, c: Corner) -> tuple[Any, Any]:
    """Return the compression of a corner and its rate [m, m/s]."""
    compression = wheel.z - (ride.z + c.y * ride.phi - c.x * ride.theta)
    rate = wheel.vz - (ride.vz + c.y * ride.p - c.x * ride.q)
    return compression, rate


def force_on_body(travel, opposite, contact_force, c: Corner):
    """Return the upward force on the body by spring, damper, anti-roll bar and links [N].

    travel, opposite: those of this wheel and of the other one of its axle; contact_force: (Fx, Fy)
    in body axes [N].
    """
    (compression, rate), (Fx, Fy), axle = travel, contact_force, c.axle
    elastic = axle.ride_rate_npm * compression + axle.antiroll_npm * (compression - opposite[0])
    return elastic + axle.damper_rate_nspm * rate + -(c.roll_ratio * Fy + c.pitch_ratio * Fx)


def tyre_load(wheel, c: Corner, p):
    """Return the vertical load of a tyre [N]; that of a lifted one is zero."""
    spring = p.vertical_stiffness_npm * wheel.z + p.vertical_damping_nspm * wheel.vz
    return ca.fmax(c.Fz_static - spring, 0)


def camber(ride, c: Corner):
    """Return the camber of a wheel to the road [rad], positive about x."""
    return c.axle.camber_per_roll * ride.phi - c.side * c.axle.static_camber_rad


def ride_acceleration(ride, planar, body_forces, contact_forces, corners, p):
    """Return vertical [m/s^2], roll and pitch acceleration [rad/s^2] of the body.

    body_forces: upward [N] per corner; contact_forces: (Fx, Fy) per corner, body axes [N].
    Aerodynamic lift acts at the axles.
    """
    body, (front, rear) = p.body, (p.suspension.front, p.suspension.rear)
    unsprung = 2 * (front.unsprung_mass_kg + rear.unsprung_mass_kg)
    sprung, height = body.mass_kg - unsprung, body.cog_height_m
    weight = sprung * body.gravity_mps2
    wheelbase = body.cog_to_front_m + body.cog_to_rear_m

    def arm(at_front, at_rear):
        """Return the height of the CoG over a line through two heights at the axles."""
        return height - (at_front * body.cog_to_rear_m + at_rear * body.cog_to_front_m) / wheelbase

    roll = weight * arm(front.roll_centre_height_m, rear.roll_centre_height_m) * ride.phi
    pitch = weight * arm(front.pitch_centre_height_m, rear.pitch_centre_height_m) * ride.theta
    for F, (Fx, Fy), c in zip(body_forces, contact_forces, corners):
        roll += c.y * F + height * Fy
        pitch -= c.x * F + height * Fx
    dynamic_pressure = body.air_density_kgpm3 / 2 * (planar.vx**2 + planar.vy**2)
    air_f = dynamic_pressure * body.front_lift_area_m2
    air_r = dynamic_pressure * body.rear_lift_area_m2
    pitch -= body.cog_to_front_m * air_f - body.cog_to_rear_m * air_r
    lift = sum(body_forces[1:], body_forces[0]) + air_f + air_r
    return lift / sprung, roll / body.roll_inertia_kgm2, pitch / body.pitch_inertia_kgm2


def roll_steer(rack: Any, phi: Any, suspension) -> tuple:
    """Return the wheel angles by rack and roll angle phi, in the order of WHEELS."""
    front = rack - suspension.front.roll_steer * phi
    return (front,) * 2 + (suspension.rear.roll_steer * phi,) * 2


def compliance_steer(angles: tuple, Fy: list, suspension) -> tuple:
    """Return the angles with compliance to the lateral forces Fy; both in the order of WHEELS.

    Left and right turn alike, by the force of their axle.
    """
    fl, fr, rl, rr = angles
    front = suspension.front.compliance_steer_radpn * (Fy[0] + Fy[1])
    rear = suspension.rear.compliance_steer_radpn * (Fy[2] + Fy[3])
    return fl - front, fr - front, rl + rear, rr + rear
