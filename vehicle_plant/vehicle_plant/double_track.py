"""Double-track model of the car: time derivative of the state, and outputs. SI, ISO 8855 axes.

42 states: planar motion of the CoG, heave, roll and pitch, four wheels with vertical travel, spin,
brake lining and transient slips, three servos. The velocity of a contact patch is that of the CoG
plus yaw, roll, pitch and travel; every tyre force acts on each of these with the same arm, so power
is conserved. Not modelled: Ackermann and toe geometry, suspension compliance (it is in the tyre's
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
    ends = ((axles.front, front), (axles.rear, rear))
    return tuple(suspension.corner(body, axle, x, side) for axle, x in ends for side in (1, -1))


def derivative(x: State, u: SetPoints, plant, friction: PerWheel) -> tuple[State, Outputs]:
    """Return the derivative of the state and the outputs at this instant.

    plant: `car.PlantParams`; friction: of the road under each wheel, relative to the tyre's test
    surface.
    """
    p = plant.car
    corners = wheel_corners(p)
    travels = [suspension.travel(x.ride, w, c) for w, c in zip(x.wheels, corners)]
    velocities = [_contact_velocity(x, c, rate, p.body) for c, (_, rate) in zip(corners, travels)]
    toes = suspension.roll_steer(x.servos.steer.position, x.ride.phi, p.suspension)
    tyres = [
        _tyre(x.ride, w, c, V, toe, mu, plant)
        for w, c, V, toe, mu in zip(x.wheels, corners, velocities, toes, friction)
    ]
    angles = suspension.compliance_steer(toes, [t.force.Fy for t in tyres], p.suspension)

    axle_forces = (x.servos.front.position,) * 2 + (x.servos.rear.position,) * 2
    loads, wheel_dots, contact_forces = [], [], []
    for w, t, V, angle, axle_force in zip(x.wheels, tyres, velocities, angles, axle_forces):
        drive, brake, rolling = wheel.torques(w, axle_force, t.Fz, p.wheel, p.brake)
        torque = drive + brake + rolling - t.force.Fx * p.wheel.radius_m
        m = wheel.contact_motion(*V, angle, w.omega, p.wheel.radius_m)
        slip_dot = wheel.slip_rate(w, m, t.slope, t.grip, p.wheel)
        wheel_dots.append((torque / p.wheel.spin_inertia_kgm2, slip_dot))
        loads.append(WheelLoad(drive + brake, t.Fz, *t.force))
        contact_forces.append(wheel.in_vehicle_axes(t.force, angle))

    acceleration, planar_dot = _planar(x.planar, contact_forces, corners, p.body)
    body_forces, lifts = _vertical(travels, loads, contact_forces, corners)
    air = suspension.air_lift(x.planar, p.body)
    vz_dot, p_dot, q_dot = suspension.ride_acceleration(
        x.ride, body_forces, contact_forces, corners, air, p
    )
    ride_dot = Ride(x.ride.vz, vz_dot, x.ride.p, p_dot, x.ride.q, q_dot)
    wheels_dot = FourWheels(
        *(
            WheelState(w.vz, lift, spin, w.omega / p.brake.windup_rad, *slip_dot)
            for w, lift, (spin, slip_dot) in zip(x.wheels, lifts, wheel_dots)
        )
    )
    outputs = Outputs(acceleration, FourLoads(*loads))
    servos_dot = map(actuators.servo_derivative, x.servos, u, actuators.servo_parameters(p))
    return State(planar_dot, ride_dot, wheels_dot, Servos(*servos_dot)), outputs


class _Tyre(NamedTuple):
    """Force and slopes of a tyre at its present slip."""

    force: tyre.Force  # wheel axes
    slope: tyre.Stiffness
    Fz: Any  # N, of the road
    grip: Any  # N, friction times load


def _contact_velocity(x: State, c: suspension.Corner, rate, body):
    """Return the velocity (Vx, Vy) of a contact patch in vehicle axes; rate: of its compression."""
    planar, ride = x.planar, x.ride
    Vx = planar.vx - c.y * planar.r - body.cog_height_m * ride.q + c.pitch_ratio * rate
    Vy = planar.vy + c.x * planar.r + body.cog_height_m * ride.p + c.roll_ratio * rate
    return Vx, Vy


def _tyre(ride, w: WheelState, c: suspension.Corner, velocity, angle, friction, plant) -> _Tyre:
    """Return the state of a tyre at its transient slips."""
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


def _planar(planar: Planar, contact_forces, corners, body):
    """Return acceleration and state derivative of the planar motion; drag acts at the CoG."""
    drag = body.air_density_kgpm3 / 2 * body.drag_area_m2
    speed = ca.sqrt(planar.vx**2 + planar.vy**2)
    Fx = -drag * speed * planar.vx
    Fy = -drag * speed * planar.vy
    Mz = 0
    for (fx, fy), c in zip(contact_forces, corners):
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


def _vertical(travels, loads, contact_forces, corners):
    """Return the upward force on the body and the acceleration of the wheel, per corner."""
    opposite = (1, 0, 3, 2)
    body_forces, lifts = [], []
    for i, (load, (Fx, Fy), c) in enumerate(zip(loads, contact_forces, corners)):
        compression, rate = travels[i]
        F = suspension.spring_force(compression, rate, travels[opposite[i]][0], c)
        F += suspension.link_force(Fx, Fy, c)
        body_forces.append(F)
        lifts.append((load.Fz - c.Fz_static - F) / c.axle.unsprung_mass_kg)
    return body_forces, lifts


def project_constraints(x: State, p) -> State:
    """Return the state within its constraints: lining wind-up, mechanical stops (p: `Car`)."""
    return x._replace(
        wheels=FourWheels(*(wheel.limit_windup(w) for w in x.wheels)),
        servos=Servos(*map(actuators.stop_at_limits, x.servos, actuators.servo_parameters(p))),
    )
