"""State, set-points and readings of the plant as named vectors (see `named`), SI, ISO 8855 axes."""

from typing import Any, NamedTuple

from vehicle_plant.actuators import Servo


class Planar(NamedTuple):
    """The CoG in the plane: pose in the map, velocities in the vehicle frame."""

    X: Any  # m
    Y: Any  # m
    psi: Any  # rad
    vx: Any  # m/s
    vy: Any  # m/s
    r: Any  # rad/s


class Ride(NamedTuple):
    """The sprung body against its static position."""

    z: Any  # m, up
    vz: Any  # m/s
    phi: Any  # rad, roll, positive: left side up
    p: Any  # rad/s
    theta: Any  # rad, pitch, positive: nose down
    q: Any  # rad/s


class Wheel(NamedTuple):
    """One wheel and its tyre."""

    z: Any  # m, up, against its static position
    vz: Any  # m/s
    omega: Any  # rad/s, spin, positive forwards
    windup: Any  # -, brake lining: -1 and 1 slip, between them it sticks
    kappa: Any  # -, transient longitudinal slip
    tan_alpha: Any  # -, transient side slip, Vy / |Vx|


class Wheels(NamedTuple):
    """One of anything per wheel, in the order of `msgs_yaml.types.WHEELS`."""

    fl: Any
    fr: Any
    rl: Any
    rr: Any


class FourWheels(NamedTuple):
    """The wheels' states."""

    fl: Wheel
    fr: Wheel
    rl: Wheel
    rr: Wheel


class Servos(NamedTuple):
    """Steering angle [rad], axle forces at the contact patches [N]."""

    steer: Servo
    front: Servo
    rear: Servo


class State(NamedTuple):
    """Everything that is integrated."""

    planar: Planar
    ride: Ride
    wheels: FourWheels
    servos: Servos


class SetPoints(NamedTuple):
    """What the servos follow."""

    delta: Any  # rad
    Fxf: Any  # N
    Fxr: Any  # N


class Acceleration(NamedTuple):
    """Of the CoG without gravity, vehicle frame."""

    ax: Any  # m/s^2
    ay: Any  # m/s^2


class Load(NamedTuple):
    """What a wheel transmits, tyre axes."""

    torque: Any  # N m, drive plus brake
    Fz: Any  # N
    Fx: Any  # N
    Fy: Any  # N


class FourLoads(NamedTuple):
    """The wheels' loads."""

    fl: Load
    fr: Load
    rl: Load
    rr: Load


class Readings(NamedTuple):
    """What is measured but not integrated."""

    acceleration: Acceleration
    loads: FourLoads
