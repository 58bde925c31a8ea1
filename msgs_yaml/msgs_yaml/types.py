"""The values of every topic as named tuples: SI units, ISO 8855 axes, the paper's symbols.

Every value has `stamp_ns`, the ROS time at which it is valid [ns]. Positions and headings
are in the frame `map` (x east, y north, psi counter-clockwise from x); velocities are in the
vehicle frame `base_link` at the centre of gravity (x forward, y left). Wheels are ordered
front-left, front-right, rear-left, rear-right (`WHEELS`).
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

WHEELS = ('fl', 'fr', 'rl', 'rr')


class VehicleState(NamedTuple):
    """Planar motion of the centre of gravity (CoG): /vehicle/odometry."""

    stamp_ns: int
    X: float  # m, map
    Y: float  # m, map
    psi: float  # rad, map, in (-pi, pi]
    vx: float  # m/s, base_link
    vy: float  # m/s, base_link
    r: float  # rad/s, yaw rate


class EstimatedState(NamedTuple):
    """What an estimator believes of a `VehicleState`, with covariances: /estimator/odometry."""

    stamp_ns: int
    X: float  # m, map
    Y: float  # m, map
    psi: float  # rad, map, in (-pi, pi]
    vx: float  # m/s, base_link
    vy: float  # m/s, base_link
    r: float  # rad/s, yaw rate
    # variances and covariances, in the products of the units above; all 0 where nothing is stated
    var_X: float
    cov_X_Y: float
    cov_X_psi: float
    var_Y: float
    cov_Y_psi: float
    var_psi: float
    var_vx: float
    cov_vx_vy: float
    cov_vx_r: float
    var_vy: float
    cov_vy_r: float
    var_r: float

    @property
    def state(self) -> VehicleState:
        """The state alone, as a controller takes it."""
        return VehicleState(*self[: len(VehicleState._fields)])


class Actuators(NamedTuple):
    """State of the actuators, behind their lag: /vehicle/actuators."""

    stamp_ns: int
    delta: float  # rad, road-wheel angle
    d_delta: float  # rad/s
    Fxf: float  # N, front axle force at the contact patch, braking negative
    Fxr: float  # N, rear axle
    torque: tuple[float, float, float, float]  # N m per wheel, drive plus brake


class Imu(NamedTuple):
    """Accelerations at the CoG without gravity: /vehicle/imu."""

    stamp_ns: int
    ax: float  # m/s^2, base_link
    ay: float  # m/s^2, base_link
    r: float  # rad/s, yaw rate
    p: float = 0.0  # rad/s, roll rate


class Inertial(NamedTuple):
    """What a car measures of its motion in the rolling and pitching body: /sensors/inertial."""

    stamp_ns: int
    ax: float  # m/s^2, with the share of gravity
    ay: float  # m/s^2, the same
    r: float  # rad/s, yaw rate
    p: float = 0.0  # rad/s, roll rate


class Wheels(NamedTuple):
    """Wheel and tyre quantities, each a tuple in the order of `WHEELS`: /vehicle/wheels."""

    stamp_ns: int
    omega: tuple[float, float, float, float]  # rad/s, spin
    torque: tuple[float, float, float, float]  # N m, drive plus brake
    Fz: tuple[float, float, float, float]  # N, vertical load
    kappa: tuple[float, float, float, float]  # -, longitudinal slip
    Fx: tuple[float, float, float, float]  # N, in the tyre frame
    alpha: tuple[float, float, float, float]  # rad, slip angle
    Fy: tuple[float, float, float, float]  # N, in the tyre frame


class Chassis(NamedTuple):
    """What a car measures of its wheels and steering: /sensors/chassis."""

    stamp_ns: int
    delta: float  # rad, road-wheel angle
    omega: tuple[float, float, float, float]  # rad/s, spin in the order of `WHEELS`


class Gnss(NamedTuple):
    """A fix of a receiver, moved to the CoG: /sensors/gnss."""

    stamp_ns: int  # of the fix, before it arrives
    X: float  # m, map
    Y: float  # m, map
    vX: float  # m/s, map
    vY: float  # m/s, map


SensorReading = Inertial | Chassis | Gnss


class Command(NamedTuple):
    """Set-points due 50 ms after the stamp of the state they answer: /controller/command."""

    stamp_ns: int
    delta: float  # rad, road-wheel angle
    d_delta: float  # rad/s, its mean rate towards the set-point
    Fxf: float  # N, front axle force at the contact patch, braking negative
    Fxr: float  # N, rear axle


class StopPlan(NamedTuple):
    """Set-points after those of a command, for n >= 1 instants: /controller/stop_plan."""

    stamp_ns: int  # of the command
    t: np.ndarray  # (n,) s after stamp_ns, increasing: when they are due
    delta: np.ndarray  # (n,) rad, road-wheel angle
    Fxf: np.ndarray  # (n,) N, front axle force at the contact patch, braking negative
    Fxr: np.ndarray  # (n,) N, rear axle


class Reference(NamedTuple):
    """The behaviour planner's coarse path, n >= 2 poses: /scenario/reference."""

    stamp_ns: int
    X: np.ndarray  # (n,) m
    Y: np.ndarray  # (n,) m
    psi: np.ndarray  # (n,) rad, continuous (unwrapped)
    # (n,) s, when the desired vehicle passes, t[0] = 0, strictly increasing; all 0 where unknown
    t: np.ndarray


class RoadEdges(NamedTuple):
    """Left and right edge of the road as polylines in driving order: /scenario/road_edges."""

    stamp_ns: int
    left: np.ndarray  # (n, 2) m
    right: np.ndarray  # (m, 2) m


class Obstacle(NamedTuple):
    """One object of one or several discs; it moves with constant velocity."""

    id: int
    X: float  # m, centre of its first disc at the stamp of the message
    Y: float  # m
    r_obs: float  # m, radius of every disc
    vX: float  # m/s, map
    vY: float  # m/s, map
    # m, map: the centres of its further discs, from that of the first one
    others: tuple[tuple[float, float], ...] = ()

    def discs(self) -> tuple['Obstacle', ...]:
        """Return its discs, the first one first, as obstacles of one disc with its id."""
        further = (self._replace(X=self.X + x, Y=self.Y + y, others=()) for x, y in self.others)
        return (self._replace(others=()), *further) if self.others else (self,)


class Refusal(NamedTuple):
    """Why an object of a message is not used."""

    kind: str  # word: what is wrong with it
    reason: str  # with its id and what is allowed


class Obstacles(NamedTuple):
    """Every obstacle known at the stamp: /scenario/obstacles."""

    stamp_ns: int  # 0 of an array without markers, which has no stamp
    items: tuple[Obstacle, ...]
    refused: tuple[Refusal, ...] = ()  # objects that are not among the items


class Branch(NamedTuple):
    """One hypothesis of where the first disc of an obstacle will be, at n >= 1 instants."""

    stamp_ns: int  # of the message
    probability: float
    t: np.ndarray  # (n,) s after stamp_ns, increasing
    X: np.ndarray  # (n,) m
    Y: np.ndarray  # (n,) m
    covariance: np.ndarray  # (n, 2, 2) m^2, of X and Y, positive semidefinite


class Predictions(NamedTuple):
    """Where obstacles will be, from who knows better than a guess: /scenario/predictions."""

    stamp_ns: int
    # the hypotheses of an obstacle by its id; what their probabilities lack to 1 is not known
    by_id: Mapping[int, tuple[Branch, ...]]
    refused: tuple[Refusal, ...] = ()  # of obstacles that are not in it


class Prediction(NamedTuple):
    """The controller's plan, one pose per stage, N + 1 of them: /controller/prediction."""

    stamp_ns: int
    X: np.ndarray  # (N + 1,) m
    Y: np.ndarray  # (N + 1,) m
    psi: np.ndarray  # (N + 1,) rad
    t: np.ndarray  # (N + 1,) s after stamp_ns, t[0] = 0


class Why(NamedTuple):
    """Diagnostics of a tick, the reasons of its command: /controller/why.

    `values` maps names to numbers or short words. Names are fixed in the contract; a group is
    written with a dot, as in `cost.con`, `v2o.1` (obstacle id 1), `time.solve_ms`.
    """

    stamp_ns: int
    level: int  # 0 OK, 1 WARN, 2 ERROR (diagnostic_msgs)
    message: str  # one line of text
    values: dict[str, float | int | str | bool]


class Health(NamedTuple):
    """State of one node: a status of /diagnostics (REP-107)."""

    stamp_ns: int
    name: str  # node name
    level: int  # 0 OK, 1 WARN, 2 ERROR, 3 STALE
    message: str
    values: dict[str, float | int | str | bool]
