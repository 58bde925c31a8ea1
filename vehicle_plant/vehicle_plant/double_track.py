"""The car: time derivative of the state, and what is measured. 42 states, SI, ISO 8855 axes.

Planar motion of the CoG, heave, roll and pitch, four wheels with vertical travel, spin, brake
lining and transient slips, three servos. The velocity of a contact patch is that of the CoG plus
yaw, roll, pitch and travel; every tyre force acts on each of these with the same arm, so power is
conserved. Not modelled: Ackermann and toe geometry, suspension compliance (it is in the tyre's
LKY, or in compliance_steer_radpn), gyroscopic moments, aligning moments, ABS.
"""

from typing import Any, NamedTuple

import casadi as ca

from vehicle_plant import actuators, suspension, tyre, wheel
from vehicle_plant.state import (
    Acceleration,
    FourLoads,
    FourWheels,
    Outputs,
    PerWheel,
    Planar,
    Ride,
    Servos,
    SetPoints,
    State,
    WheelLoad,
    WheelState,
)


def wheel_corners(p):
    """Return the four corners of a `car.Car`, in the order of WHEELS."""
    body, axles = p.body, p.suspension
    front, rear = body.cog_to_front_m, -body.cog_to_rear_m
    places = ((axles.front, front), (axles.rear, rear))
    return tuple(suspension.corner(body, axle, x, side) for axle, x in places for side in (1, -1))


def derivative(x: State, u: SetPoints, plant, friction: PerWheel) -> tuple[State, Outputs]:
    """Return the derivative of the state, as a State, and the readings at this instant.

    friction: that of the road under each wheel, over that of the tyre's test surface.
    """
    p = plant.car
    at = wheel_corners(p)
    travels = [suspension.travel(x.ride, w, c) for w, c in zip(x.wheels, at)]
    velocities = [_contact_velocity(x, c, rate, p.body) for c, (_, rate) in zip(at, travels)]
    toes = suspension.roll_steer(x.servos.steer.position, x.ride.phi, p.suspension)
    tyres = [
        _tyre(x.ride, w, c, V, toe, mu, plant)
        for w, c, V, toe, mu in zip(x.wheels, at, velocities, toes, friction)
    ]
    angles = suspension.compliance_steer(toes, [one.force.Fy for one in tyres], p.suspension)

    axle_forces = (x.servos.front.position,) * 2 + (x.servos.rear.position,) * 2
    loads, wheel_dots, contact_forces = [], [], []
    for w, one, V, angle, axle_force in zip(x.wheels, tyres, velocities, angles, axle_forces):
        drive, brake, rolling = wheel.torques(w, axle_force, one.Fz, p.wheel, p.brake)
        torque = drive + brake + rolling - one.force.Fx * p.wheel.radius_m
        m = wheel.contact_motion(*V, angle, w.omega, p.wheel.radius_m)
        slip_dot = wheel.slip_rate(w, m, one.slope, one.grip, p.wheel)
        wheel_dots.append((torque / p.wheel.spin_inertia_kgm2, slip_dot))
        loads.append(WheelLoad(drive + brake, one.Fz, *one.force))
        contact_forces.append(wheel.in_vehicle_axes(one.force, angle))

    acceleration, planar_dot = _planar(x.planar, contact_forces, at, p.body)
    body_forces, lifts = _vertical(travels, loads, contact_forces, at)
    air = suspension.air_lift(x.planar, p.body)
    vz_dot, p_dot, q_dot = suspension.ride_acceleration(
        x.ride, body_forces, contact_forces, at, air, p
    )
    ride_dot = Ride(x.ride.vz, vz_dot, x.ride.p, p_dot, x.ride.q, q_dot)
    wheels_dot = FourWheels(
        *(
            WheelState(w.vz, lift, spin, wheel.windup_rate(w, p.brake), *slip_dot)
            for w, lift, (spin, slip_dot) in zip(x.wheels, lifts, wheel_dots)
        )
    )
    readings = Outputs(acceleration, FourLoads(*loads))
    return State(planar_dot, ride_dot, wheels_dot, _servos(x.servos, u, p)), readings


class _Tyre(NamedTuple):
    """A tyre at work."""

    force: tyre.Force  # wheel axes
    slope: tyre.Stiffness
    Fz: Any  # N, of the road
    grip: Any  # N, friction times load


def _contact_velocity(x: State, c: suspension.Corner, rate, body):
    """Return the velocity of a contact patch in vehicle axes; rate: of the corner's travel."""
    planar, ride = x.planar, x.ride
    Vx = planar.vx - c.y * planar.r - body.cog_height_m * ride.q + c.pitch_ratio * rate
    Vy = planar.vy + c.x * planar.r + body.cog_height_m * ride.p + c.roll_ratio * rate
    return Vx, Vy


def _tyre(ride, w: WheelState, c: suspension.Corner, velocity, angle, friction, plant) -> _Tyre:
    """Return the force of a tyre by its transient slips."""
    p = plant.car
    m = wheel.contact_motion(*velocity, angle, w.omega, p.wheel.radius_m)
    Fz = suspension.tyre_load(w, c, p.wheel)
    contact = tyre.Contact(
        Fz=ca.fmax(Fz, p.wheel.minimum_load_n),
        kappa=0,
        tan_alpha=0,
        gamma=suspension.camber(ride, c),
        friction=friction,
        pressure=p.wheel.pressure_pa,
    )
    scaling = p.scaling.front if c.axle is p.suspension.front else p.scaling.rear
    slope = tyre.stiffness(contact, plant.tyre, scaling)
    kappa, tan_alpha = wheel.tyre_slip(w, m, slope, p.wheel)
    law = tyre.force if c.side > 0 else tyre.mirrored_force
    F = law(contact._replace(kappa=kappa, tan_alpha=tan_alpha), plant.tyre, scaling)
    return _Tyre(F, slope, Fz, friction * contact.Fz)


def _planar(planar: Planar, contact_forces, at, body):
    """Newton and Euler in the plane; drag acts at the CoG."""
    drag = body.air_density_kgpm3 / 2 * body.drag_area_m2
    speed = ca.sqrt(planar.vx**2 + planar.vy**2)
    Fx = -drag * speed * planar.vx
    Fy = -drag * speed * planar.vy
    Mz = 0
    for (fx, fy), c in zip(contact_forces, at):
        Fx += fx
        Fy += fy
        Mz += c.x * fy - c.y * fx
    ax, ay = Fx / body.mass_kg, Fy / body.mass_kg
    c, s = ca.cos(planar.psi), ca.sin(planar.psi)
    rates = Planar(
        X=planar.vx * c - planar.vy * s,
        Y=planar.vx * s + planar.vy * c,
        psi=planar.r,
        vx=ax + planar.r * planar.vy,
        vy=ay - planar.r * planar.vx,
        r=Mz / body.yaw_inertia_kgm2,
    )
    return Acceleration(ax, ay), rates


def _vertical(travels, loads, contact_forces, at):
    """Return the upward force on the body and the acceleration of the wheel, per corner."""
    opposite = {0: 1, 1: 0, 2: 3, 3: 2}
    body_forces, lifts = [], []
    for i, ((here, rate), load, (Fx, Fy), c) in enumerate(zip(travels, loads, contact_forces, at)):
        F = suspension.spring_force(here, rate, travels[opposite[i]][0], c)
        F += suspension.link_force(Fx, Fy, c)
        body_forces.append(F)
        lifts.append((load.Fz - c.Fz_static - F) / c.axle.unsprung_mass_kg)
    return body_forces, lifts


def _servos(servos: Servos, u: SetPoints, p) -> Servos:
    steering = actuators.steering_limits(p.steering)
    front = actuators.force_limits(p.force.front)
    rear = actuators.force_limits(p.force.rear)
    return Servos(
        actuators.servo_derivative(servos.steer, u.delta, p.steering, steering),
        actuators.servo_derivative(servos.front, u.Fxf, p.force.front, front),
        actuators.servo_derivative(servos.rear, u.Fxr, p.force.rear, rear),
    )


def project_constraints(x: State, p) -> State:
    """Return the state after a step, back within what sticks and what stops (p: `Car`)."""
    return x._replace(
        wheels=FourWheels(*(wheel.limit_windup(w) for w in x.wheels)),
        servos=Servos(
            actuators.stop_at_limits(x.servos.steer, actuators.steering_limits(p.steering)),
            actuators.stop_at_limits(x.servos.front, actuators.force_limits(p.force.front)),
            actuators.stop_at_limits(x.servos.rear, actuators.force_limits(p.force.rear)),
        ),
    )
