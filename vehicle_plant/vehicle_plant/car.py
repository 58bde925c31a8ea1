"""Parameters of the car: one frozen dataclass per part, filled from config/, SI units.

`actuator_limits` is the summary of the actuators for a controller.
"""

from dataclasses import replace
from typing import Annotated, NamedTuple

from node_runtime.parameters import Range, Struct
from vehicle_plant.tyre_coefficients import TyreCoefficients, TyreScaling

Ratio = Annotated[float, Range(0.0, 1.0, '-')]
Height = Annotated[float, Range(-0.2, 1.0, 'm')]
LiftArea = Annotated[float, Range(-3.0, 3.0, 'm^2')]
DelayMs = Annotated[int, Range(0, 200, 'ms')]


class Body(Struct):
    """Masses and lengths. Inertias are those of the whole car about its CoG."""

    mass_kg: Annotated[float, Range(500.0, 5000.0, 'kg')]
    # about the longitudinal axis
    roll_inertia_kgm2: Annotated[float, Range(50.0, 5000.0, 'kg m^2')]
    pitch_inertia_kgm2: Annotated[float, Range(200.0, 20000.0, 'kg m^2')]  # about the lateral axis
    yaw_inertia_kgm2: Annotated[float, Range(200.0, 20000.0, 'kg m^2')]  # about the vertical axis
    cog_to_front_m: Annotated[float, Range(0.5, 3.0, 'm')]  # CoG to the front axle
    cog_to_rear_m: Annotated[float, Range(0.5, 3.0, 'm')]  # CoG to the rear axle
    cog_height_m: Annotated[float, Range(0.1, 1.5, 'm')]  # above the road
    drag_area_m2: Annotated[float, Range(0.0, 3.0, 'm^2')]
    front_lift_area_m2: LiftArea
    rear_lift_area_m2: LiftArea  # the same of the rear axle
    air_density_kgpm3: Annotated[float, Range(0.5, 2.0, 'kg/m^3')]  # of the drag and lift
    gravity_mps2: Annotated[float, Range(1.0, 20.0, 'm/s^2')]  # of the axle loads


class Outline(Struct):
    """Outline for collisions; without effect on the motion."""

    front_overhang_m: Annotated[float, Range(0.0, 3.0, 'm')]
    rear_overhang_m: Annotated[float, Range(0.0, 3.0, 'm')]
    width_m: Annotated[float, Range(0.5, 3.0, 'm')]  # of the body


class Axle(Struct):
    """Suspension of one axle; rates are per wheel, at the wheel."""

    track_m: Annotated[float, Range(0.5, 3.0, 'm')]  # between the wheel centres
    # vertical stiffness at the wheel, without anti-roll bar
    ride_rate_npm: Annotated[float, Range(5e3, 200e3, 'N/m')]
    damper_rate_nspm: Annotated[float, Range(100.0, 20e3, 'N s/m')]  # of the damper
    antiroll_npm: Annotated[float, Range(0.0, 200e3, 'N/m')]
    roll_centre_height_m: Height  # above the road
    pitch_centre_height_m: Height
    unsprung_mass_kg: Annotated[float, Range(10.0, 100.0, 'kg')]
    static_camber_rad: Annotated[float, Range(-0.1, 0.1, 'rad')]
    camber_per_roll: Ratio
    roll_steer: Annotated[float, Range(-0.5, 0.5, '-')]
    compliance_steer_radpn: Annotated[float, Range(-1e-5, 1e-5, 'rad/N')]


class Suspension(Struct):
    """Suspension of both axles."""

    front: Axle
    rear: Axle


class Wheel(Struct):
    """A wheel with the carcass of its tyre; all four are equal."""

    radius_m: Annotated[float, Range(0.1, 1.0, 'm')]  # from the axis to the road
    # with brake disc and half-shaft
    spin_inertia_kgm2: Annotated[float, Range(0.2, 10.0, 'kg m^2')]
    vertical_stiffness_npm: Annotated[float, Range(50e3, 1e6, 'N/m')]  # of the carcass
    vertical_damping_nspm: Annotated[float, Range(0.0, 5e3, 'N s/m')]  # of the carcass
    longitudinal_stiffness_npm: Annotated[float, Range(50e3, 2e6, 'N/m')]
    lateral_stiffness_npm: Annotated[float, Range(20e3, 1e6, 'N/m')]  # of the carcass
    rolling_resistance: Annotated[float, Range(0.0, 0.1, '-')]  # rolling force over load
    pressure_pa: Annotated[float, Range(50e3, 500e3, 'Pa')]  # inflation of the tyre
    minimum_load_n: Annotated[float, Range(0.01, 50.0, 'N')]
    minimum_relaxation_m: Annotated[float, Range(0.02, 0.5, 'm')]
    minimum_relaxation_s: Annotated[float, Range(0.0004, 0.005, 's')]
    greatest_slip: Annotated[float, Range(1.0, 10.0, '-')]
    standstill_slip: Annotated[float, Range(0.01, 1.0, '-')]
    standstill_speed_mps: Annotated[float, Range(0.1, 5.0, 'm/s')]
    # of the carcass at standstill
    standstill_damping_nspm: Annotated[float, Range(0.0, 10e3, 'N s/m')]


class BrakeLining(Struct):
    """Elastic wind-up and damping of a brake lining before it slips."""

    windup_rad: Annotated[float, Range(0.005, 0.2, 'rad')]
    damping_s: Annotated[float, Range(0.0, 0.02, 's')]  # damping of the wind-up over its stiffness


class Steering(Struct):
    """Second-order servo of the road-wheel angle."""

    natural_frequency_radps: Annotated[float, Range(1.0, 300.0, 'rad/s')]  # of the servo
    damping: Annotated[float, Range(0.3, 3.0, '-')]  # ratio of the servo, 1: no overshoot
    limit_rad: Annotated[float, Range(0.05, 1.2, 'rad')]  # at the road wheel, either way
    rate_radps: Annotated[float, Range(0.05, 20.0, 'rad/s')]  # at the road wheel
    delay_ms: DelayMs


class AxleForce(Struct):
    """Second-order servo of one axle's brake and drive force at the contact patches."""

    natural_frequency_radps: Annotated[float, Range(1.0, 300.0, 'rad/s')]  # of the servo
    damping: Annotated[float, Range(0.3, 3.0, '-')]  # ratio of the servo, 1: no overshoot
    brake_n: Annotated[float, Range(0.0, 50e3, 'N')]  # largest brake force of the axle
    # largest drive force of the axle; 0: not driven
    drive_n: Annotated[float, Range(0.0, 50e3, 'N')]
    rate_nps: Annotated[float, Range(1e3, 1e7, 'N/s')]  # of the force
    delay_ms: DelayMs  # pure delay before the servo


class AxleForces(Struct):
    """Force servos of both axles."""

    front: AxleForce
    rear: AxleForce


class AxleScaling(Struct):
    """Scaling of the tyre coefficients per axle."""

    front: TyreScaling
    rear: TyreScaling


class GateLimits(Struct):
    """Limits of a plausible command, relative to those of the actuators."""

    steer_tolerance_rad: Annotated[float, Range(0.0, 0.1, 'rad')]
    force_tolerance_n: Annotated[float, Range(0.0, 5e3, 'N')]
    steer_rate_radps: Annotated[float, Range(0.1, 100.0, 'rad/s')]
    force_rate_nps: Annotated[float, Range(1e3, 1e7, 'N/s')]
    friction_use: Annotated[float, Range(0.5, 10.0, 'of the friction of an axle')]


class SafeStop(Struct):
    """Brake forces when the controller is gone, at friction 1."""

    front_brake_n: Annotated[float, Range(0.0, 50e3, 'N')]  # of the front axle
    rear_brake_n: Annotated[float, Range(0.0, 50e3, 'N')]  # of the rear axle


class Car(Struct):
    """All parameters of the car except the coefficients of its tyre."""

    body: Body
    outline: Outline
    suspension: Suspension
    wheel: Wheel
    brake: BrakeLining
    steering: Steering
    force: AxleForces
    scaling: AxleScaling
    gate: GateLimits
    safe_stop: SafeStop


class PlantParams(Struct):
    """The car and its tyre."""

    car: Car
    tyre: TyreCoefficients


class MultiBodyParams(PlantParams):
    """The same for the multi-body model, which has masses, suspension and tyres of its own.

    Of the car its actuators, gate and outline count; the rest describes it to others.
    """


def add_delay(car: Car, delay_ms: int) -> Car:
    """Return the car with a later response of every servo to its set-points."""

    def delayed(servo):
        return replace(servo, delay_ms=servo.delay_ms + delay_ms)

    force = replace(car.force, front=delayed(car.force.front), rear=delayed(car.force.rear))
    return replace(car, steering=delayed(car.steering), force=force)


class FaultParams(Struct):
    """Faults of the actuators for a while; those left out are none."""

    from_s: Annotated[float, Range(0.0, 1e4, 's')] | None  # since the start; left out: 0
    until_s: Annotated[float, Range(0.0, 1e4, 's')] | None  # left out: to the end
    steer_stuck: bool | None  # the steering keeps the set-point of that instant
    steer_offset_rad: Annotated[float, Range(-0.2, 0.2, 'rad')] | None  # to the left
    front_force_share: Ratio | None  # of the force of the axle, brakes and drive; 0: lost
    rear_force_share: Ratio | None  # the same of the rear axle
    delay_ms: DelayMs | None  # beside that of the servos


class ActuatorLimits(NamedTuple):
    """Driven axle, and the greatest values of the actuators."""

    drive_front_share: float  # 0 = rear-wheel drive
    steer_rad: float  # at the road wheel, either way
    steer_rate_radps: float
    brake_n: float  # N, both axles
    drive_n: float  # N, both axles
    force_rate_nps: float  # N/s, of the slower axle


def actuator_limits(car: Car) -> ActuatorLimits:
    """Return the limits of a car's actuators; one without an engine counts as rear-wheel drive."""
    front, rear = car.force.front, car.force.rear
    drive_n = front.drive_n + rear.drive_n
    return ActuatorLimits(
        drive_front_share=front.drive_n / drive_n if drive_n else 0.0,
        steer_rad=car.steering.limit_rad,
        steer_rate_radps=car.steering.rate_radps,
        brake_n=front.brake_n + rear.brake_n,
        drive_n=drive_n,
        force_rate_nps=min(front.rate_nps, rear.rate_nps),
    )


def split_drive_force(car: Car, force: float) -> tuple[float, float]:
    """Return front and rear axle force [N], shared as the engine can drive them.

    Raises ValueError for a car without an engine.
    """
    front, rear = car.force.front.drive_n, car.force.rear.drive_n
    if not front + rear:
        raise ValueError('the car has no engine: force.front.drive_n and force.rear.drive_n are 0')
    return force * front / (front + rear), force * rear / (front + rear)
