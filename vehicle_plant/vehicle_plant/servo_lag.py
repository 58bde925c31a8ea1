"""Lag of the actuators, measured on the plant: how far they follow behind a ramp of set-points."""

from typing import NamedTuple

import numpy as np

from msgs_yaml.types import Command
from vehicle_plant.initial_state import Start
from vehicle_plant.parameters import PlantParams
from vehicle_plant.simulator import TICK_NS, TICK_STEPS, Simulator
from vehicle_plant.state import join_trajectories

# slow enough for any tyre and rate limit, straight ahead at a speed that the ramps hardly change
SPEED_MPS = 20.0
STEER_RATE_RADPS = 0.02
FORCE_RATE_NPS = -2000.0  # of both axles
RAMP_TICKS = 24  # 1.2 s, tens of time constants of a servo
SETTLED_TICKS = 4  # over which the lag is averaged


class ServoLags(NamedTuple):
    """How long an actuator is behind a set-point that moves at a constant rate."""

    steer_s: float
    force_s: float  # of the total force


def measure(plant: PlantParams, friction: float) -> ServoLags:
    """Return the lags of steering and total force on a ramp of each; a delay is part of the lag.

    For the second-order servo it is 2 zeta / omega. Raises RefusedError.
    """
    steer = _ramp(plant, friction, STEER_RATE_RADPS, 0.0)
    force = _ramp(plant, friction, 0.0, FORCE_RATE_NPS)
    total = sum(force.column(f'servos.{axle}.position') for axle in ('front', 'rear'))
    return ServoLags(
        _lag(steer.stamp_ns, steer.column('servos.steer.position') / STEER_RATE_RADPS),
        _lag(force.stamp_ns, total / FORCE_RATE_NPS),
    )


def _ramp(plant, friction, steer_rate, force_rate):
    """Return the trajectory of a ramp from zero, every millisecond."""
    car = Simulator(plant, friction, Start(0.0, 0.0, 0.0, SPEED_MPS))
    tracks, began_ns = [car.now], car.stamp_ns
    for _ in range(RAMP_TICKS):
        t = (car.stamp_ns + TICK_NS - began_ns) / 1e9
        force = force_rate * t / 2
        tracks.append(car.follow(Command(car.stamp_ns, steer_rate * t, steer_rate, force, force)))
    return join_trajectories(tracks)


def _lag(stamp_ns, reached_s):
    """Return the mean lag [s] at the end; `reached_s` is when the ramp had the present value."""
    behind = (stamp_ns - stamp_ns[0]) / 1e9 - reached_s
    return float(np.mean(behind[-SETTLED_TICKS * TICK_STEPS :]))
