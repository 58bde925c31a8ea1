"""Quasi-steady circular driving (ISO 4138): the manoeuvre, and slip and forces of each axle."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from msgs_yaml.types import Command
from node_runtime.parameters import Choice, Range
from vehicle_plant.initial_state import Start
from vehicle_plant.parameters import PlantParams
from vehicle_plant.simulator import TICK_NS, TICK_STEPS, Simulator
from vehicle_plant.state import Trajectory, join_trajectories


@dataclass(frozen=True)
class CircleParams:
    """Both manoeuvres of ISO 4138 to the left until the front axle slides: config/identify.yaml."""

    manoeuvre: Annotated[str, Choice('constant_speed', 'constant_radius')]
    speed_mps: Annotated[float, Range(5.0, 50.0, 'm/s')]
    steer_rate_radps: Annotated[float, Range(0.001, 0.05, 'rad/s')]
    radius_m: Annotated[float, Range(15.0, 500.0, 'm')]
    acceleration_mps2: Annotated[float, Range(0.02, 1.0, 'm/s^2')]
    curvature_gain_radpm: Annotated[float, Range(0.1, 100.0, 'rad m/s')]
    last_front_slip_rad: Annotated[float, Range(0.02, 0.4, 'rad')]
    longest_s: Annotated[float, Range(1.0, 600.0, 's')]
    speed_gain_nspm: Annotated[float, Range(0.0, 50e3, 'N s/m')]
    settle_s: Annotated[float, Range(0.0, 20.0, 's')]


STANDARD_GRAVITY = 9.80665  # m/s^2


class CircleError(RuntimeError):
    """The manoeuvre did not reach its end."""


class AxlePoints(NamedTuple):
    """One axle over the manoeuvre; arrays (n,). ISO 8855 axes, at the front turned by steer."""

    alpha: np.ndarray  # rad, slip angle at the middle of the axle
    Fx: np.ndarray  # N
    Fy: np.ndarray  # N
    Fz: np.ndarray  # N


def drive(plant: PlantParams, friction: float, circle: CircleParams) -> Trajectory:
    """Drive the manoeuvre; return its rows every 50 ms. Raises CircleError."""
    driver_class = {'constant_speed': _ConstantSpeed, 'constant_radius': _ConstantRadius}
    driver = driver_class[circle.manoeuvre](circle, plant)
    car = Simulator(plant, friction, Start(0.0, 0.0, 0.0, driver.speed(0.0)))
    rear_share = rear_drive_share(plant)
    tick_s = TICK_NS / 1e9
    rows = []
    for tick in range(round(circle.longest_s / tick_s)):
        state = car.state
        t = max(tick * tick_s - circle.settle_s, 0.0)
        force = circle.speed_gain_nspm * (driver.speed(t) - state.vx)
        forces = force * (1 - rear_share), force * rear_share
        steer = driver.steer(t, state)
        if not car.command(Command(state.stamp_ns, steer, driver.steer_rate, *forces)).accepted:
            raise CircleError(f'the plant refuses the command: {car.gate.last_reason}')
        car.advance(None, TICK_STEPS)
        rows.append(car.now)
        front, _ = axle_points(rows[-1], plant)
        if abs(front.alpha[-1]) >= circle.last_front_slip_rad:
            turning = [row for i, row in enumerate(rows) if i * tick_s >= circle.settle_s]
            return join_trajectories(turning)
    raise CircleError(f'front slip {abs(front.alpha[-1]):.3f} rad after {circle.longest_s} s')


class _ConstantSpeed:
    """Slowly increasing steer."""

    def __init__(self, circle: CircleParams, _):
        self._circle = circle
        self.steer_rate = circle.steer_rate_radps

    def speed(self, _) -> float:
        """Return the desired speed [m/s]."""
        return self._circle.speed_mps

    def steer(self, t, _) -> float:
        """Return the steer command [rad] at the time t of the manoeuvre [s]."""
        return t * self._circle.steer_rate_radps


class _ConstantRadius:
    """Slowly increasing speed; integral control of the curvature from the geometric steer on."""

    def __init__(self, circle: CircleParams, plant: PlantParams):
        body = plant.car.body
        self._circle = circle
        self._steer = (body.cog_to_front_m + body.cog_to_rear_m) / circle.radius_m
        self._limit = plant.car.steering.limit_rad
        self.steer_rate = 0.0

    def speed(self, t) -> float:
        """Return the desired speed [m/s]; at first the lateral acceleration is a tenth of g."""
        slow = np.sqrt(0.1 * STANDARD_GRAVITY * self._circle.radius_m)
        return float(slow + self._circle.acceleration_mps2 * t)

    def steer(self, t, state) -> float:
        """Return the steer command [rad]; the settling time reaches it gently."""
        error = 1 / self._circle.radius_m - state.r / state.vx
        gain = self._circle.curvature_gain_radpm * TICK_NS / 1e9
        self._steer = float(np.clip(self._steer + gain * error, -self._limit, self._limit))
        return self._steer


def rear_drive_share(plant: PlantParams) -> float:
    """Return the share of the rear axle in the drive force. Raises CircleError without any."""
    force = plant.car.force
    if not force.front.drive_n + force.rear.drive_n:
        raise CircleError('the car has no engine: force.front.drive_n and force.rear.drive_n are 0')
    return force.rear.drive_n / (force.front.drive_n + force.rear.drive_n)


def axle_points(trajectory: Trajectory, plant: PlantParams) -> tuple[AxlePoints, AxlePoints]:
    """Return slip angle and forces of the front and of the rear axle over a trajectory."""
    body = plant.car.body
    vx, vy, r = (trajectory.column(f'planar.{name}') for name in ('vx', 'vy', 'r'))
    steer = trajectory.column('servos.steer.position')
    front = np.arctan2(vy + body.cog_to_front_m * r, vx) - steer
    rear = np.arctan2(vy - body.cog_to_rear_m * r, vx)

    def total(wheels, name):
        return sum(trajectory.column(f'loads.{w}.{name}') for w in wheels)

    return tuple(
        AxlePoints(alpha, *(total(wheels, name) for name in ('Fx', 'Fy', 'Fz')))
        for alpha, wheels in ((front, ('fl', 'fr')), (rear, ('rl', 'rr')))
    )
