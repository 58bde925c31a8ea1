"""One wheel: slip with relaxation, spin, brake. No division by speed, smooth through standstill.

Transient slip: sigma kappa' + V kappa = -Vsx, sigma (tan alpha)' + V tan alpha = Vy (Pacejka 2012,
7.2), sigma = slip stiffness over carcass stiffness. At standstill this is a spring; its damping
fades in below a low speed (Pacejka 2012, 8.6), and its deflection is limited by tread sliding.
The brake is an elastic-plastic lining (Prandtl): it sticks, winds up, then slips at its torque.
"""

from typing import Any, NamedTuple

import casadi as ca

from vehicle_plant import tyre


class ContactMotion(NamedTuple):
    """Velocity of the contact patch in wheel axes, and slip speed."""

    Vx: Any  # m/s
    Vy: Any  # m/s
    Vsx: Any  # m/s, Vx - omega R


def contact_motion(vx, vy, delta, omega, radius) -> ContactMotion:
    """Return the contact motion of a wheel steered by delta; vx, vy in vehicle axes."""
    Vx = ca.cos(delta) * vx + ca.sin(delta) * vy
    Vy = -ca.sin(delta) * vx + ca.cos(delta) * vy
    return ContactMotion(Vx, Vy, Vx - omega * radius)


def in_vehicle_axes(force: tyre.Force, delta):
    """Return the force on a wheel steered by delta as (Fx, Fy) in vehicle axes."""
    c, s = ca.cos(delta), ca.sin(delta)
    return c * force.Fx - s * force.Fy, s * force.Fx + c * force.Fy


def _moving(m: ContactMotion, p):
    """Return a factor that rises smoothly from 0 at standstill to 1 at the standstill speed."""
    speed = ca.sqrt(m.Vx**2 + m.Vy**2 + m.Vsx**2)
    return (1 - ca.cos(ca.pi * ca.fmin(speed / p.standstill_speed_mps, 1))) / 2


def slip_rate(wheel, m: ContactMotion, slope: tyre.Stiffness, grip, p):
    """Return the derivatives of transient kappa and tan(alpha) [1/s]; grip: friction times Fz [N].

    The relaxation length is deflection over slip, so it falls with slip: a sliding tyre is
    deflected by no more than its friction force does. V is |Vx|, in deep sliding more, such that
    neither slip passes its greatest value; at |slip| <= 0.5 the difference is below 0.1 %.
    """
    greatest = p.standstill_slip + (p.greatest_slip - p.standstill_slip) * _moving(m, p)
    V = ca.sqrt(ca.sqrt(m.Vx**4 + (m.Vsx**4 + m.Vy**4) / greatest**4))
    used = ((slope.Kx * wheel.kappa) ** 2 + (slope.Ky * wheel.tan_alpha) ** 2) / grip**2
    shortening = 1 / ca.sqrt(1 + used)
    sigma_x = slope.Kx / p.longitudinal_stiffness_npm * shortening
    sigma_y = -slope.Ky / p.lateral_stiffness_npm * shortening
    # a wheel that spins up on ice turns so fast that its lag would be unstable in the integrator
    shortest = ca.fmax(p.minimum_relaxation_m, V * p.minimum_relaxation_s)
    sigma_x = ca.fmax(sigma_x, shortest)
    sigma_y = ca.fmax(sigma_y, shortest)
    return (-m.Vsx - V * wheel.kappa) / sigma_x, (m.Vy - V * wheel.tan_alpha) / sigma_y


def tyre_slip(wheel, m: ContactMotion, slope: tyre.Stiffness, p):
    """Return kappa and tan(alpha) of the tyre: transient slips with the standstill damping."""
    damping = p.standstill_damping_nspm * (1 - _moving(m, p))
    return wheel.kappa - damping * m.Vsx / slope.Kx, wheel.tan_alpha - damping * m.Vy / slope.Ky


def torques(wheel, axle_force, Fz, p, lining):
    """Return drive torque, brake torque and rolling-resistance torque on the wheel [N m].

    The axle force [N] is shared equally by left and right: open differential, one brake circuit.
    """
    per_wheel = axle_force * p.radius_m / 2
    engaged = wheel.windup + wheel.omega * lining.damping_s / lining.windup_rad
    engaged = ca.fmin(ca.fmax(engaged, -1), 1)
    brake = ca.fmin(per_wheel, 0) * engaged
    rolling = -p.rolling_resistance * Fz * p.radius_m * engaged
    return ca.fmax(per_wheel, 0), brake, rolling
