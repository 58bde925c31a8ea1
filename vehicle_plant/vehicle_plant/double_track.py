"""The car: time derivative of the state, and what is measured. 42 states, SI, ISO 8855 axes.

Planar motion of the CoG, heave, roll and pitch, four wheels with vertical travel, spin, brake
lining and transient slips, three servos. The velocity of a contact patch is that of the CoG plus
yaw, roll, pitch and travel; every tyre force acts on each of these with the same arm, so power is
conserved. Not modelled: Ackermann and toe geometry, suspension compliance (it is in the tyre's
LKY), gyroscopic moments, aligning moments, aerodynamic lift, ABS.
"""

import casadi as ca

from vehicle_plant import actuators, suspension, tyre, wheel
from vehicle_plant.state import (
    Acceleration,
    FourLoads,
    FourWheels,
    Load,
    Planar,
    Readings,
    Ride,
    Servos,
    SetPoints,
    State,
    Wheel,
)


def corners(p):
    """Return the four corners of a `parameters.Car`, in the order of WHEELS."""
    body, axles = p.body, p.suspension
    front, rear = body.cog_to_front_m, -body.cog_to_rear_m
    places = ((axles.front, front), (axles.rear, rear))
    return tuple(suspension.corner(body, axle, x, side) for axle, x in places for side in (1, -1))


def derivative(x: State, u: SetPoints, plant, friction) -> tuple[State, Readings]:
    """Return the derivative of the state, as a State, and the readings at this instant."""
    p = plant.car
    planar, ride = x.planar, x.ride
    at = corners(p)
    travels = [suspension.travel(ride, w, c) for w, c in zip(x.wheels, at)]
    steer = (x.servos.steer.position, x.servos.steer.position, 0, 0)
    axle_forces = (x.servos.front.position,) * 2 + (x.servos.rear.position,) * 2
    scalings = (p.scaling.front,) * 2 + (p.scaling.rear,) * 2

    loads, slip_rates, contact_forces, spins = [], [], [], []
    for w, c, (_, rate), delta, axle_force, scaling in zip(
        x.wheels, at, travels, steer, axle_forces, scalings
    ):
        Vx = planar.vx - c.y * planar.r - p.body.cog_height_m * ride.q + c.pitch_ratio * rate
        Vy = planar.vy + c.x * planar.r + p.body.cog_height_m * ride.p + c.roll_ratio * rate
        m = wheel.motion(Vx, Vy, delta, w.omega, p.wheel.radius_m)
        Fz = suspension.tyre_load(w, c, p.wheel)
        contact = tyre.Contact(
            Fz=ca.fmax(Fz, p.wheel.minimum_load_n),
            kappa=0,
            tan_alpha=0,
            gamma=suspension.camber(ride, c),
            friction=friction,
            pressure=p.wheel.pressure_pa,
        )
        slope = tyre.stiffness(contact, plant.tyre, scaling)
        kappa, tan_alpha = wheel.tyre_slip(w, m, slope, p.wheel)
        contact = contact._replace(kappa=kappa, tan_alpha=tan_alpha)
        law = tyre.force if c.side > 0 else tyre.mirrored_force
        F = law(contact, plant.tyre, scaling)
        drive, brake, rolling = wheel.torques(w, axle_force, Fz, p.wheel, p.brake)
        spins.append(
            (drive + brake + rolling - F.Fx * p.wheel.radius_m) / p.wheel.spin_inertia_kgm2
        )
        loads.append(Load(drive + brake, Fz, F.Fx, F.Fy))
        grip = friction * contact.Fz
        slip_rates.append(wheel.slip_rate(w, m, slope, grip, p.wheel))
        contact_forces.append(
            (
                ca.cos(delta) * F.Fx - ca.sin(delta) * F.Fy,
                ca.sin(delta) * F.Fx + ca.cos(delta) * F.Fy,
            )
        )

    acceleration, planar_dot = _planar(planar, contact_forces, at, p.body)
    body_forces, lifts = _vertical(travels, loads, contact_forces, at)
    vz_dot, p_dot, q_dot = suspension.ride_acceleration(ride, body_forces, contact_forces, at, p)
    ride_dot = Ride(ride.vz, vz_dot, ride.p, p_dot, ride.q, q_dot)
    wheels_dot = FourWheels(
        *(
            Wheel(w.vz, lift, spin, wheel.windup_rate(w, p.brake), *slip_dot)
            for w, lift, spin, slip_dot in zip(x.wheels, lifts, spins, slip_rates)
        )
    )
    servos_dot = _servos(x.servos, u, p)
    readings = Readings(acceleration, FourLoads(*loads))
    return State(planar_dot, ride_dot, wheels_dot, servos_dot), readings


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
    steering = actuators.limits_of_steering(p.steering)
    front = actuators.limits_of_force(p.force.front)
    rear = actuators.limits_of_force(p.force.rear)
    return Servos(
        actuators.derivative(servos.steer, u.delta, p.steering, steering),
        actuators.derivative(servos.front, u.Fxf, p.force.front, front),
        actuators.derivative(servos.rear, u.Fxr, p.force.rear, rear),
    )


def settled(x: State, p) -> State:
    """Return the state after a step, back within what sticks and what stops (p: `Car`)."""
    return x._replace(
        wheels=FourWheels(*(wheel.slipped(w) for w in x.wheels)),
        servos=Servos(
            actuators.stopped(x.servos.steer, actuators.limits_of_steering(p.steering)),
            actuators.stopped(x.servos.front, actuators.limits_of_force(p.force.front)),
            actuators.stopped(x.servos.rear, actuators.limits_of_force(p.force.rear)),
        ),
    )
