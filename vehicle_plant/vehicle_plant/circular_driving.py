"""Quasi-steady circular driving (ISO 4138): the manoeuvre, and slip and forces of each axle."""

from typing import Annotated, NamedTuple

import numpy as np

from msgs_yaml.types import Command
from node_runtime.parameters import Choice, Range, Struct
from vehicle_plant.car import split_drive_force
from vehicle_plant.initial_state import Start
from vehicle_plant.parameters import PlantParams
from vehicle_plant.simulator import TICK_NS, Simulator
from vehicle_plant.state import Trajectory, join_trajectories


class CircleParams(Struct):
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
    """Drive the manoeuvre; return its rows every 50 ms. Raises CircleError.

    constant_speed: slowly increasing steer. constant_radius: slowly increasing speed from a lateral
    acceleration of a tenth of g on, integral control of the curvature from the geometric steer on.
    """
    is_constant_speed = circle.manoeuvre == 'constant_speed'
    body, steer_limit = plant.car.body, plant.car.steering.limit_rad
    steer = (body.cog_to_front_m + body.cog_to_rear_m) / circle.radius_m
    steer_rate = circle.steer_rate_radps if is_constant_speed else 0.0
    initial_speed = float(np.sqrt(0.1 * STANDARD_GRAVITY * circle.radius_m))
    speed = circle.speed_mps if is_constant_speed else initial_speed
    car = Simulator(plant, friction, Start(0.0, 0.0, 0.0, speed))
    tick_s = TICK_NS / 1e9
    rows = []
    for tick in range(round(circle.longest_s / tick_s)):
        state = car.state
        t = max(tick * tick_s - circle.settle_s, 0.0)
        if is_constant_speed:
            steer = t * circle.steer_rate_radps
        else:
            speed = initial_speed + circle.acceleration_mps2 * t
            curvature_error = 1 / circle.radius_m - state.r / state.vx
            steer += circle.curvature_gain_radpm * TICK_NS / 1e9 * curvature_error
            steer = float(np.clip(steer, -steer_limit, steer_limit))
        force = circle.speed_gain_nspm * (speed - state.vx)
        try:
            forces = split_drive_force(plant.car, force)
            car.follow(Command(state.stamp_ns, steer, steer_rate, *forces))
        except ValueError as error:  # no engine, or the gate refuses the command
            raise CircleError(str(error)) from None
        rows.append(car.now)
        front, _ = axle_points(rows[-1], plant)
        if abs(front.alpha[-1]) >= circle.last_front_slip_rad:
            turning = [row for i, row in enumerate(rows) if i * tick_s >= circle.settle_s]
            return join_trajectories(turning)
    raise CircleError(f'front slip {abs(front.alpha[-1]):.3f} rad after {circle.longest_s} s')


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
