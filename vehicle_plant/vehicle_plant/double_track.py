"""Double-track model of the car: time derivative of the state, and outputs. SI, ISO 8855 axes.

42 states: planar motion of the CoG, heave, roll and pitch, four wheels with vertical travel, spin,
brake lining and transient slips, three servos. The velocity of a contact patch is that of the CoG
plus yaw, roll, pitch and travel; every tyre force acts on each of these with the same arm, so power
is conserved. Not modelled: Ackermann and toe geometry, suspension compliance (it is in the tyre's
LKY, or in compliance_steer_radpn), gyroscopic moments, aligning moments, ABS.
"""

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


def derivative(x: State, u: SetPoints, plant, friction: PerWheel) -> tuple[State, Outputs]:
    """Return the derivative of the state and the outputs at this instant.

    plant: `car.PlantParams`; friction: of the road under each wheel, relative to the tyre's test
    surface.
    """
    p, planar, ride = plant.car, x.planar, x.ride
    body, radius = p.body, p.wheel.radius_m
    corners = suspension.wheel_corners(p)
    travels = [suspension.travel(ride, w, c) for w, c in zip(x.wheels, corners)]
    velocities = [
        (
            planar.vx - c.y * planar.r - body.cog_height_m * ride.q + c.pitch_ratio * rate,
            planar.vy + c.x * planar.r + body.cog_height_m * ride.p + c.roll_ratio * rate,
        )
        for c, (_, rate) in zip(corners, travels)
    ]
    toes = suspension.roll_steer(x.servos.steer.position, ride.phi, p.suspension)
    tyres = [
        _tyre(ride, w, c, wheel.contact_motion(*V, toe, w.omega, radius), mu, plant)
        for w, c, V, toe, mu in zip(x.wheels, corners, velocities, toes, friction)
    ]
    lateral = [force.Fy for force, *_ in tyres]
    angles = suspension.compliance_steer(toes, lateral, p.suspension)

    axle_forces = (x.servos.front.position,) * 2 + (x.servos.rear.position,) * 2
    loads, rates, contact_forces = [], [], []
    for w, (force, slope, Fz, grip), V, angle, axle_force in zip(
        x.wheels, tyres, velocities, angles, axle_forces
    ):
        drive, brake, rolling = wheel.torques(w, axle_force, Fz, p.wheel, p.brake)
        torque = drive + brake + rolling - force.Fx * radius
        m = wheel.contact_motion(*V, angle, w.omega, radius)
        slip_dot = wheel.slip_rate(w, m, slope, grip, p.wheel)
        spin_dot = torque / p.wheel.spin_inertia_kgm2
        rates.append((spin_dot, w.omega / p.brake.windup_rad, *slip_dot))
        loads.append(WheelLoad(drive + brake, Fz, *force))
        contact_forces.append(wheel.in_vehicle_axes(force, angle))

    acceleration, planar_dot = _planar(planar, contact_forces, corners, body)
    opposite = (travels[i] for i in (1, 0, 3, 2))
    body_forces = [*map(suspension.force_on_body, travels, opposite, contact_forces, corners)]
    lifts = [
        (load.Fz - c.Fz_static - F) / c.axle.unsprung_mass_kg
        for load, c, F in zip(loads, corners, body_forces)
    ]
    vz_dot, p_dot, q_dot = suspension.ride_acceleration(
        ride, planar, body_forces, contact_forces, corners, p
    )
    ride_dot = Ride(ride.vz, vz_dot, ride.p, p_dot, ride.q, q_dot)
    wheels_dot = FourWheels(
        *(WheelState(w.vz, lift, *rate) for w, lift, rate in zip(x.wheels, lifts, rates))
    )
    servos_dot = map(actuators.servo_derivative, x.servos, u, actuators.servo_parameters(p))
    outputs = Outputs(acceleration, FourLoads(*loads))
    return State(planar_dot, ride_dot, wheels_dot, Servos(*servos_dot)), outputs


def _tyre(ride, w: WheelState, c: suspension.Corner, m: wheel.ContactMotion, friction, plant):
    """Return force in wheel axes, slopes, load of the road and friction times load of a tyre."""
    p = plant.car
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
    force = law(contact._replace(kappa=kappa, tan_alpha=tan_alpha), plant.tyre, scaling)
    return force, slope, Fz, friction * contact.Fz


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


def project_constraints(x: State, p) -> State:
    """Return the state within its constraints: lining wind-up, mechanical stops (p: `Car`)."""
    return x._replace(
        wheels=FourWheels(*(wheel.limit_windup(w) for w in x.wheels)),
        servos=Servos(*map(actuators.stop_at_limits, x.servos, actuators.servo_parameters(p))),
    )
