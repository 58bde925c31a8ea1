"""Quasi-steady circular driving: the manoeuvre, and what each axle does in it."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from msgs_yaml.parameters import Range
from msgs_yaml.types import Command
from vehicle_plant.parameters import PlantParams
from vehicle_plant.simulator import TICK_NS, TICK_STEPS, Simulator, Start
from vehicle_plant.track import Track, join


@dataclass(frozen=True)
class Circle:
    """Constant speed, slowly increasing steer: config/identify.yaml."""

    speed_mps: Annotated[float, Range(5.0, 50.0, 'm/s')]
    steer_rate_radps: Annotated[float, Range(0.001, 0.05, 'rad/s')]
    last_front_slip_rad: Annotated[float, Range(0.02, 0.4, 'rad')]
    longest_s: Annotated[float, Range(1.0, 600.0, 's')]
    speed_gain_nspm: Annotated[float, Range(0.0, 50e3, 'N s/m')]
    settle_s: Annotated[float, Range(0.0, 20.0, 's')]


class CircleError(RuntimeError):
    """The manoeuvre did not reach its end."""


class AxlePoints(NamedTuple):
    """One axle over the manoeuvre; arrays (n,). ISO 8855 axes, at the front turned by steer."""

    alpha: np.ndarray  # rad, slip angle at the middle of the axle
    Fx: np.ndarray  # N
    Fy: np.ndarray  # N
    Fz: np.ndarray  # N


def drive(plant: PlantParams, friction: float, circle: Circle) -> Track:
    """Drive the manoeuvre; rows at the 50 ms boundaries. Raises CircleError."""
    car = Simulator(plant, friction, Start(0.0, 0.0, 0.0, circle.speed_mps))
    tick_s = TICK_NS / 1e9
    ticks = round(circle.longest_s / tick_s)
    rows = []
    for tick in range(ticks):
        state = car.state
        steer = max(tick * tick_s - circle.settle_s, 0.0) * circle.steer_rate_radps
        force = circle.speed_gain_nspm * (circle.speed_mps - state.vx)
        command = Command(state.stamp_ns, steer, circle.steer_rate_radps, 0.0, force)
        if not car.command(command).accepted:
            raise CircleError(f'the plant refuses the command: {car.gate.last_reason}')
        car.advance(None, TICK_STEPS)
        rows.append(car.now)
        front, _ = axles(rows[-1], plant)
        if abs(front.alpha[-1]) >= circle.last_front_slip_rad:
            return join([row for i, row in enumerate(rows) if i * tick_s >= circle.settle_s])
    raise CircleError(f'front slip {abs(front.alpha[-1]):.3f} rad after {circle.longest_s} s')


def axles(track: Track, plant: PlantParams) -> tuple[AxlePoints, AxlePoints]:
    """Return front and rear axle over a track."""
    body = plant.car.body
    vx, vy, r = (track.column(f'planar.{name}') for name in ('vx', 'vy', 'r'))
    steer = track.column('servos.steer.position')
    front = np.arctan2(vy + body.cog_to_front_m * r, vx) - steer
    rear = np.arctan2(vy - body.cog_to_rear_m * r, vx)

    def total(pair, name):
        return sum(track.column(f'loads.{w}.{name}') for w in pair)

    return tuple(
        AxlePoints(alpha, *(total(pair, name) for name in ('Fx', 'Fy', 'Fz')))
        for alpha, pair in ((front, ('fl', 'fr')), (rear, ('rl', 'rr')))
    )
