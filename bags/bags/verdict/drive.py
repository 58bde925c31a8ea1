"""What the judge looks at: one drive as plain arrays, SI units, whatever it was read from.

Positions are in the frame `map`, velocities and accelerations in `base_link` (ISO 8855).
"""

from typing import NamedTuple

import numpy as np

from bags.errors import BagError
from bags.verdict.geometry import Outline
from msgs_yaml.stamp import NS_PER_S

LONGEST_S = 86_400.0  # of a drive


class Motion(NamedTuple):
    """The centre of gravity, one entry per odometry message."""

    stamp_ns: np.ndarray
    x: np.ndarray  # m
    y: np.ndarray  # m
    yaw: np.ndarray  # rad
    vx: np.ndarray  # m/s
    vy: np.ndarray  # m/s


class Accelerations(NamedTuple):
    """What the inertial unit at the centre of gravity measured."""

    stamp_ns: np.ndarray
    ax: np.ndarray  # m/s^2
    ay: np.ndarray  # m/s^2


class Inputs(NamedTuple):
    """Where the actuators were."""

    stamp_ns: np.ndarray
    steer: np.ndarray  # rad, at the road wheels
    force: np.ndarray  # N, both axles, braking negative


class Ticks(NamedTuple):
    """What the controller said about each of its steps, and which states it answered."""

    answered_ns: np.ndarray  # stamps of the commands
    solve_ms: np.ndarray  # wall time, ms, one per /controller/why
    solve_cpu_ms: np.ndarray  # processor time likewise; not-a-number where a bag does not tell
    fallback: np.ndarray  # rung of the ladder, 0 = solved, one per /controller/why
    last_reason: str = ''  # why the last step followed no fresh plan; '' when it did


class Obstacle(NamedTuple):
    """One obstacle over time; not-a-number where a message does not name it."""

    id: int
    x: np.ndarray  # m, one entry per obstacle message
    y: np.ndarray  # m
    vx: np.ndarray  # m/s
    vy: np.ndarray  # m/s
    radius: float  # m


class Scene(NamedTuple):
    """What the scenario published."""

    reference: np.ndarray  # (n, 2) m, the coarse path
    left: np.ndarray  # (n, 2) m, left road edge in driving order
    right: np.ndarray  # (m, 2) m
    obstacle_stamp_ns: np.ndarray  # one entry per obstacle message
    obstacles: tuple[Obstacle, ...]


class Facts(NamedTuple):
    """Parameters of the nodes of that run which the judge needs."""

    scenario: str
    controller: str
    outline: Outline
    circles: tuple[float, ...]  # m, vehicle circle centres ahead of the centre of gravity
    vehicle_radius: float  # m
    safe_obstacle: float  # m, D_sft,O
    safe_edge: float  # m, D_sft,E
    friction: float  # peak lateral acceleration over g that the road offers
    tick_ns: int  # controller period
    stop: tuple[float, float]  # m, a point of the finish line
    armed_after: float  # m, travelled before the finish line counts
    least_speed: float | None = None  # m/s, below which the controller only brakes


class Drive(NamedTuple):
    """One run."""

    motion: Motion
    accelerations: Accelerations
    inputs: Inputs
    ticks: Ticks
    scene: Scene
    facts: Facts


def finite(one: Drive) -> Drive:
    """Return a drive without the samples of car, accelerations and inputs that are not finite.

    Raises BagError when no state of the car is left, and for samples more than LONGEST_S apart:
    what is computed every 10 ms takes memory for all of that time.
    """
    found = one._replace(
        motion=_finite(one.motion),
        accelerations=_finite(one.accelerations),
        inputs=_finite(one.inputs),
    )
    if not found.motion.stamp_ns.size:
        raise BagError(f'{one.facts.controller}: no state of the car is finite')
    for columns in (found.motion, found.accelerations, found.inputs):
        span_s = int(np.ptp(columns.stamp_ns)) / NS_PER_S if columns.stamp_ns.size else 0.0
        if span_s > LONGEST_S:
            raise BagError(
                f'{one.facts.controller}: the stamps of the car span {span_s:.0f} s; '
                f'allowed up to {LONGEST_S:.0f} s'
            )
    return found


def _finite(columns):
    kept = np.all([np.isfinite(column) for column in columns], axis=0)
    return columns if kept.all() else type(columns)(*(column[kept] for column in columns))
