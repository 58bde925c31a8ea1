"""How a manoeuvre is driven: set-points every 50 ms, straight lines between, as by a controller."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from vehicle_plant import delay, graph, stepper
from vehicle_plant.car import PlantParams
from vehicle_plant.manoeuvres.settings import Settings
from vehicle_plant.simulator import START_NS, STEP_NS, TICK_STEPS, Start, trimmed
from vehicle_plant.state import SetPoints
from vehicle_plant.track import Track

TICK_S = TICK_STEPS * graph.STEP_S


class Case(NamedTuple):
    """A car on a road, and what the manoeuvres ask of it."""

    plant: PlantParams
    friction: float  # of the road over that of the tyre's test surface
    settings: Settings

    def scaled(self, acceleration: float) -> float:
        """Return an acceleration meant for dry road as this road allows it [m/s^2]."""
        return acceleration * min(self.friction, 1.0)


class Run(NamedTuple):
    """One run of a manoeuvre, from straight rolling."""

    label: str
    speed: float  # m/s at the start
    seconds: float
    law: Callable[[float, float], SetPoints]  # (instant they are due [s], vx now [m/s]) -> them


class Number(NamedTuple):
    """A result."""

    value: float
    unit: str
    meaning: str


class Manoeuvre(NamedTuple):
    """A test procedure; tracks come in the order of the runs."""

    about: str
    runs: Callable[[Case], tuple[Run, ...]]
    numbers: Callable[[Case, tuple[Run, ...], list[Track]], dict[str, Number]]
    draw: Callable[[Case, tuple[Run, ...], list[Track]], Any]  # a matplotlib Figure


def drive(run: Run, case: Case, step_s: float = graph.STEP_S, side: int = 1) -> Track:
    """Return the track of a run, one row per millisecond, the first at 1 ms.

    step_s: of the integrator, a whole fraction or multiple of 1 ms that divides 50 ms; a longer
    one leaves fewer rows. side: -1 mirrors the steer. With 1 ms the track is that of a `Simulator`
    under the same commands, bit by bit.
    """
    p = graph.parameter_vector(case.plant, case.friction)
    x = trimmed(case.plant, Start(0.0, 0.0, 0.0, run.speed))
    vx = run.speed
    steps = round(TICK_S / step_s)
    stride = max(round(graph.STEP_S / step_s), 1)
    done = np.arange(steps + 1)[:, None] / steps
    late = (round(n * graph.STEP_S / step_s) for n in delay.of(case.plant.car))
    line = delay.DelayLine(delay.Delays(*late), SetPoints(0.0, 0.0, 0.0))
    now = np.zeros(len(SetPoints._fields))
    rows = []
    for tick in range(1, round(run.seconds / TICK_S) + 1):
        wanted = run.law(tick * TICK_S, vx)
        due = np.array([side * wanted.delta, wanted.Fxf, wanted.Fxr])
        path = np.where(done < 1, now + (due - now) * done, due)
        burst = stepper.advance(x, line.take(path), p, step_s)
        x, now = burst[-1, : x.size].copy(), due
        rows.append(burst[stride - 1 :: stride])
        vx = Track(np.empty(0), rows[-1]).column('planar.vx')[-1]
    rows = np.concatenate(rows)
    every_ns = STEP_NS * round(step_s * stride / graph.STEP_S)
    return Track(START_NS + every_ns * np.arange(1, len(rows) + 1, dtype=np.int64), rows)


def times(track: Track) -> np.ndarray:
    """Return the time of each row since the start [s]."""
    return (track.stamp_ns - START_NS) / 1e9


def holding(case: Case, speed: float) -> Callable[[float], tuple[float, float]]:
    """Return a law vx -> front and rear axle force [N] that holds a speed.

    Raises ValueError for a car without an engine, when the law is asked.
    """
    car = case.plant.car
    needed, gain = resistances(car, speed), case.settings.speed_gain_nspm
    return lambda vx: driving(car, needed + gain * (speed - vx))


def driving(car, force: float) -> tuple[float, float]:
    """Return front and rear axle force [N], shared as the engine can drive them.

    Raises ValueError for a car without an engine.
    """
    front, rear = car.force.front.drive_n, car.force.rear.drive_n
    if not front + rear:
        raise ValueError('the car has no engine: force.front.drive_n and force.rear.drive_n are 0')
    return force * front / (front + rear), force * rear / (front + rear)


def resistances(car, speed: float) -> float:
    """Return drag and rolling resistance on a straight level road [N]."""
    body = car.body
    drag = body.air_density_kgpm3 / 2 * body.drag_area_m2 * speed**2
    return drag + car.wheel.rolling_resistance * body.mass_kg * body.gravity_mps2
