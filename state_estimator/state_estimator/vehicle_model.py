"""What the filter knows of axles and wheels: Fiala tyres beside a longitudinal force. SI units.

Forces of an axle are per mass that it carries [m/s^2]; slip is its tangent, positive where the axle
moves to the left.
"""

import math
from typing import NamedTuple

from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import WHEELS, Chassis, Inertial
from state_estimator.parameters import Vehicle

G = 9.81  # m/s^2
LEAST_SLOPE = 0.03  # share of the cornering stiffness by which a sliding tyre still counts
LEAST_CAPACITY = 0.15  # of the friction, beside the longitudinal force
MOST_USED = math.sqrt(1.0 - LEAST_CAPACITY**2)  # of the friction, by that force
STANDS_S = 0.3  # all wheels at rest and no motion in the IMU for so long
STANDS_MPS2, STANDS_RADPS = 0.6, 0.03


def tyre_force(tan_alpha: float, C: float, capacity: float) -> tuple[float, float, float]:
    """Return the lateral force of a Fiala tyre, and its slopes over slip and capacity.

    tan_alpha: [-]; C: cornering stiffness; capacity: greatest force, in the same unit.
    """
    s = C * tan_alpha / (3.0 * capacity)
    a = min(abs(s), 1.0)
    sign = math.copysign(1.0, s)
    force = -sign * capacity * a * (3.0 - 3.0 * a + a * a)
    return force, -C * (1.0 - a) ** 2, sign * a * a * (2.0 * a - 3.0)


class Axle(NamedTuple):
    """One axle."""

    arm: float  # m from the CoG, forward
    other: float  # m, of which the other axle is on the other side
    C: float  # m/s^2 per rad
    friction: float  # -
    transfer: float  # m/s^2 of load per m/s^2 of acceleration
    steered: bool

    def force(self, tan_alpha: float, ax: float, friction: float) -> tuple[float, float, float]:
        """Return the lateral force [m/s^2], its slope over slip, and over the friction of the road.

        ax: longitudinal acceleration [m/s^2], which both axles share by their loads.
        """
        load = G + self.transfer * ax
        whole = self.friction * friction * load
        wanted, most = abs(ax) * load / G, MOST_USED * whole
        capacity = math.sqrt(whole**2 - min(wanted, most) ** 2)
        force, slope, over_capacity = tyre_force(tan_alpha, self.C, capacity)
        # of the capacity over the whole, of which it is a constant share from `most` on
        over, under = (whole, capacity) if wanted < most else (capacity, whole)
        over_friction = over_capacity * over / under * self.friction * load
        return force, min(slope, -LEAST_SLOPE * self.C), over_friction


class WheelPlace(NamedTuple):
    """Where a wheel is."""

    x: float  # m from the CoG, forward
    y: float  # m, left
    steered: bool
    driven: bool


def axles(car: Vehicle) -> tuple[Axle, Axle]:
    """Return front and rear axle."""
    m, length, h = car.mass_kg, car.front_m + car.rear_m, car.cog_height_m
    front = m * car.rear_m / length, m * car.front_m / length
    return (
        Axle(car.front_m, car.rear_m, car.front_cornering_npr / front[0], car.front_friction,
             -h / car.rear_m, True),
        Axle(-car.rear_m, -car.front_m, car.rear_cornering_npr / front[1], car.rear_friction,
             h / car.front_m, False),
    )  # fmt: skip


def wheels(car: Vehicle) -> tuple[WheelPlace, ...]:
    """Return the wheels in the order of WHEELS."""
    front_drive = car.drive_front_share > 0.5
    return tuple(
        WheelPlace(
            car.front_m if name[0] == 'f' else -car.rear_m,
            0.5 * car.track_m * (1 if name[1] == 'l' else -1),
            name[0] == 'f',
            (name[0] == 'f') == front_drive,
        )
        for name in WHEELS
    )


class RestDetector:
    """Tells from wheels and IMU whether the car stands; wheels that lock are no rest."""

    def __init__(self) -> None:
        self._since_ns: int | None = None

    def update(self, imu: Inertial, chassis: Chassis, bias_ax: float, bias_r: float) -> bool:
        """Return whether the car has been at rest for a while."""
        quiet = abs(imu.r - bias_r) < STANDS_RADPS and abs(imu.ax - bias_ax) < STANDS_MPS2
        if any(chassis.omega) or not quiet:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = imu.stamp_ns
        return self._since_ns is not None and imu.stamp_ns - self._since_ns > STANDS_S * NS_PER_S
