"""Test procedures: how a manoeuvre is driven and evaluated.

Set-points come every 50 ms, linear in between, as from the controller. The functions at the end
evaluate signals: t is time [s], x and y are arrays over the rows of a trajectory.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from msgs_yaml.types import Command
from vehicle_plant.car import PlantParams, split_drive_force
from vehicle_plant.initial_state import Start
from vehicle_plant.manoeuvres.settings import Settings
from vehicle_plant.simulator import START_NS, TICK_NS, Simulator
from vehicle_plant.state import SetPoints, Trajectory, join_trajectories

TICK_S = TICK_NS / 1e9
LOW, HALF, HIGH = 0.1, 0.5, 0.9  # of the steady state: rise time, response time (ISO 7401)
MS_PER_S = 1000


class Case(NamedTuple):
    """A car on a road, and the settings of the manoeuvres."""

    plant: PlantParams
    friction: float  # of the road relative to the tyre's test surface
    settings: Settings

    def scaled(self, acceleration: float) -> float:
        """Return an acceleration of dry road scaled to this road [m/s^2]."""
        return acceleration * min(self.friction, 1.0)


class Run(NamedTuple):
    """One run of a manoeuvre, from straight rolling."""

    label: str
    speed: float  # m/s at the start
    seconds: float
    law: Callable[[float, float], SetPoints]  # (time at which they are due [s], vx now [m/s])


class Number(NamedTuple):
    """A result."""

    value: float
    unit: str
    meaning: str


def drive(run: Run, case: Case) -> Trajectory:
    """Return the trajectory of a run, one row per millisecond, the first at 1 ms.

    Raises RefusedError when the gate of the plant refuses a command.
    """
    # a law may ask an axle for more than it gives: its servo and its tyres limit that
    gate = replace(case.plant.car.gate, force_tolerance_n=np.inf, friction_use=np.inf)
    plant = replace(case.plant, car=replace(case.plant.car, gate=gate))
    car = Simulator(plant, case.friction, Start(0.0, 0.0, 0.0, run.speed))
    vx, pieces = run.speed, []
    for tick in range(1, round(run.seconds / TICK_S) + 1):
        delta, *forces = run.law(tick * TICK_S, vx)
        pieces.append(car.follow(Command(car.stamp_ns, delta, 0.0, *forces)))
        vx = pieces[-1].column('planar.vx')[-1]
    return join_trajectories(pieces)


def times(trajectory: Trajectory) -> np.ndarray:
    """Return the time of each row since the start [s]."""
    return (trajectory.stamp_ns - START_NS) / 1e9


def hold_speed(case: Case, speed: float) -> Callable[[float], tuple[float, float]]:
    """Return a law vx -> front and rear axle force [N] that holds a speed.

    The law raises ValueError for a car without an engine.
    """
    car = case.plant.car
    resistance, gain = driving_resistance(car, speed), case.settings.speed_gain_nspm
    return lambda vx: split_drive_force(car, resistance + gain * (speed - vx))


def driving_resistance(car, speed: float) -> float:
    """Return drag and rolling resistance on a straight level road [N]."""
    body = car.body
    drag = body.air_density_kgpm3 / 2 * body.drag_area_m2 * speed**2
    return drag + car.wheel.rolling_resistance * body.mass_kg * body.gravity_mps2


def first_crossing_time(t: np.ndarray, y: np.ndarray, level: float) -> float:
    """Return the instant at which y first reaches a positive level; nan when it never does."""
    above = np.flatnonzero(y >= level)
    if not len(above):
        return float('nan')
    i = above[0]
    if i == 0:
        return float(t[0])
    return float(np.interp(level, y[i - 1 : i + 1], t[i - 1 : i + 1]))


def fit_slope(x: np.ndarray, y: np.ndarray, *, low: float, high: float) -> float:
    """Return the gradient dy/dx of the straight line through the points with low <= x <= high."""
    inside = (x >= low) & (x <= high)
    return float(np.polyfit(x[inside], y[inside], 1)[0])


def phasor(t: np.ndarray, y: np.ndarray, f_hz: float) -> complex:
    """Return the complex amplitude of exp(2 pi i f t) in y, apart from a constant and a drift."""
    centred = t - t.mean()
    terms = np.column_stack(
        [np.cos(2 * np.pi * f_hz * t), np.sin(2 * np.pi * f_hz * t), np.ones_like(t), centred]
    )
    (cosine, sine, _, _), *_ = np.linalg.lstsq(terms, y, rcond=None)
    return complex(cosine, -sine)
