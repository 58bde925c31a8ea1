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


def corner(body, axle, x, side: int) -> Corner:
    """Return the corner of an axle at x [m] on side 1 (left) or -1 (right)."""
    wheelbase = body.cog_to_front_m + body.cog_to_rear_m
    y = side * axle.track_m / 2
    other_axle = wheelbase - ca.fabs(x)
    weight = body.mass_kg * body.gravity_mps2
    return Corner(
        axle=axle,
        x=x,
        y=y,
        side=side,
        roll_ratio=axle.roll_centre_height_m / y,
        pitch_ratio=axle.pitch_centre_height_m / x,
        Fz_static=weight * other_axle / wheelbase / 2,
    )


def travel(ride, wheel, c: Corner):
    """Return the compression of a corner and its rate [m, m/s]."""
    compression = wheel.z - (ride.z + c.y * ride.phi - c.x * ride.theta)
    rate = wheel.vz - (ride.vz + c.y * ride.p - c.x * ride.q)
    return compression, rate


def spring_force(compression, rate, opposite, c: Corner):
    """Return the upward force on the body by spring, damper and anti-roll bar [N].

    opposite: compression at the other wheel of the axle [m].
    """
    axle = c.axle
    elastic = axle.ride_rate_npm * compression + axle.antiroll_npm * (compression - opposite)
    return elastic + axle.damper_rate_nspm * rate


def link_force(Fx, Fy, c: Corner):
    """Return the upward force on the body by the links for a contact force in body axes [N]."""
    return -(c.roll_ratio * Fy + c.pitch_ratio * Fx)


def tyre_load(wheel, c: Corner, p):
    """Return the vertical load of a tyre [N]; that of a lifted one is zero."""
    spring = p.vertical_stiffness_npm * wheel.z + p.vertical_damping_nspm * wheel.vz
    return ca.fmax(c.Fz_static - spring, 0)


def camber(ride, c: Corner):
    """Return the camber of a wheel to the road [rad], positive about x."""
    return c.axle.camber_per_roll * ride.phi - c.side * c.axle.static_camber_rad


def air_lift(planar, body):
    """Return the aerodynamic lift of the body at the front and the rear axle [N]."""
    dynamic_pressure = body.air_density_kgpm3 / 2 * (planar.vx**2 + planar.vy**2)
    return dynamic_pressure * body.front_lift_area_m2, dynamic_pressure * body.rear_lift_area_m2


def ride_acceleration(ride, body_forces, contact_forces, corners, air, p):
    """Return vertical [m/s^2], roll and pitch acceleration [rad/s^2] of the body.

    body_forces: upward [N] per corner; contact_forces: (Fx, Fy) per corner, body axes [N];
    air: upward [N] per axle.
    """
    body, suspension = p.body, p.suspension
    unsprung = 2 * (suspension.front.unsprung_mass_kg + suspension.rear.unsprung_mass_kg)
    sprung = body.mass_kg - unsprung
    height = body.cog_height_m
    weight = sprung * body.gravity_mps2
    roll_arm = height - _at_cog(body, *(a.roll_centre_height_m for a in _axles(suspension)))
    pitch_arm = height - _at_cog(body, *(a.pitch_centre_height_m for a in _axles(suspension)))
    roll = weight * roll_arm * ride.phi
    pitch = weight * pitch_arm * ride.theta
    for F, (Fx, Fy), c in zip(body_forces, contact_forces, corners):
        roll += c.y * F + height * Fy
        pitch -= c.x * F + height * Fx
    pitch -= body.cog_to_front_m * air[0] - body.cog_to_rear_m * air[1]
    lift = sum(body_forces[1:], body_forces[0]) + air[0] + air[1]
    return lift / sprung, roll / body.roll_inertia_kgm2, pitch / body.pitch_inertia_kgm2


def _axles(suspension):
    return suspension.front, suspension.rear


def _at_cog(body, front, rear):
    """Interpolate a height between the axles."""
    wheelbase = body.cog_to_front_m + body.cog_to_rear_m
    return (front * body.cog_to_rear_m + rear * body.cog_to_front_m) / wheelbase


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
