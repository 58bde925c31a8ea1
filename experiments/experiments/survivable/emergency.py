"""An emergency: the instant from which a driver may act, and what happens around the car.

Until then the controller of the setup drives, without knowing what is to come. The fair instant is
the first one at which an obstacle was seen and a fault of the actuators, if there is one, began;
with full preview it is the start of the run. From then on a pilot knows all that will happen, and
the car is the plant itself. Places are told by the coarse path as a coordinate line: stations along
it, offsets to its left, the road's edges.
"""

import copy
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from bags.evaluation.drive import Drive, drive_from_columns
from experiments import simulation
from experiments.configuration import inputs
from experiments.simulation import Setup
from msgs_yaml import conversions
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Command, Obstacle, Obstacles, Reference, RoadEdges
from scenario_publisher import actors, scenario
from vehicle_plant.run_end import RunEnd
from vehicle_plant.simulator import TICK_NS, TICK_STEPS, Simulator
from vehicle_plant.state import Trajectory, join_trajectories

TICK_S = TICK_NS / NS_PER_S
BEYOND_M = 80.0  # the line goes on straight behind its end
SPACING_M = 0.5
Pilot = Callable[[Simulator, Obstacles], Command]  # the car now, what will be there: a command


class RoadCoordinates:
    """A line with n samples; metres, radians, frame map.

    A road that comes close to itself (laps, crossings) has several stations there; the nearest
    counts.
    """

    def __init__(self, reference: Reference, edges: RoadEdges):
        """Take the line from the coarse path, and the offsets of the edges beside it."""
        X, Y = np.asarray(reference.X, float), np.asarray(reference.Y, float)
        s = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(X), np.diff(Y)))])
        end = np.array([X[-1] - X[-2], Y[-1] - Y[-2]]) / (s[-1] - s[-2])
        beyond = np.arange(SPACING_M, BEYOND_M, SPACING_M)
        self.s = np.concatenate([s, s[-1] + beyond])
        self.X = np.concatenate([X, X[-1] + end[0] * beyond])
        self.Y = np.concatenate([Y, Y[-1] + end[1] * beyond])
        self.psi = np.unwrap(np.arctan2(np.gradient(self.Y), np.gradient(self.X)))
        self._tree = cKDTree(np.column_stack([self.X, self.Y]))
        self.left = self._edge_offset(edges.left)
        self.right = self._edge_offset(edges.right)

    def project(self, X: np.ndarray, Y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return station and offset [m] of points, arrays of any one shape."""
        X, Y = np.asarray(X, float), np.asarray(Y, float)
        _, i = self._tree.query(np.stack([X, Y], axis=-1))
        dx, dy = X - self.X[i], Y - self.Y[i]
        cos, sin = np.cos(self.psi[i]), np.sin(self.psi[i])
        return self.s[i] + dx * cos + dy * sin, dy * cos - dx * sin

    def room(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the offsets [m] of the right and the left edge at stations."""
        return np.interp(s, self.s, self.right), np.interp(s, self.s, self.left)

    def beyond_edge(self, X: np.ndarray, Y: np.ndarray) -> np.ndarray:
        """Return how far points are beyond the nearer edge [m]; negative on the road."""
        s, n = self.project(X, Y)
        right, left = self.room(s)
        return np.maximum(n - left, right - n)

    def shifted(self, s: np.ndarray, n: np.ndarray) -> 'Path':
        """Return the line at offsets n (m,) from stations s (m,), in metres."""
        x, y, psi = (np.interp(s, self.s, column) for column in (self.X, self.Y, self.psi))
        X, Y = x - n * np.sin(psi), y + n * np.cos(psi)
        along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(X), np.diff(Y)))])
        heading = np.unwrap(np.arctan2(np.gradient(Y, along), np.gradient(X, along)))
        return Path(s, X, Y, heading, np.gradient(heading, along))

    def _edge_offset(self, points):
        """Return the offset [m] of an edge at each station."""
        # an edge bends more than its vertices show: on each side of a vertex it is straight
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        fine = np.linspace(0.0, along[-1], max(2, int(along[-1] / SPACING_M) + 1))
        x, y = (np.interp(fine, along, column) for column in points.T)
        s, n = self.project(x, y)
        order = np.argsort(s, kind='stable')
        return np.interp(self.s, s[order], n[order])


class Path(NamedTuple):
    """A line beside the course, m samples in driving order."""

    s: np.ndarray  # m, station on the course
    X: np.ndarray  # m
    Y: np.ndarray  # m
    psi: np.ndarray  # rad, heading, continuous
    kappa: np.ndarray  # 1/m


def reference_of(path: Path, speed: np.ndarray, stamp_ns: int) -> Reference:
    """Return a path as the coarse path of a controller; `speed` (m,) [m/s] is the desired one."""
    steps = np.hypot(np.diff(path.X), np.diff(path.Y))
    t = np.concatenate([[0.0], np.cumsum(steps / ((speed[1:] + speed[:-1]) / 2))])
    return Reference(stamp_ns, path.X, path.Y, path.psi, t)


class Rollout(NamedTuple):
    """What a pilot did from the instant of action on."""

    pieces: list[Trajectory]  # one per tick
    commands: list[Command]
    ended: bool  # by itself: finish, standstill or time limit

    def states(self) -> np.ndarray:
        """Return rows X, Y, psi, vx, vy every 10 ms, (5, n); SI units."""
        names = [f'planar.{name}' for name in ('X', 'Y', 'psi', 'vx', 'vy')]
        columns = ([piece.column(name)[9::10] for piece in self.pieces] for name in names)
        return np.array([np.concatenate(column) for column in columns])

    def stamps(self) -> np.ndarray:
        """Return the stamps [ns] of `states`, (n,)."""
        return np.concatenate([piece.stamp_ns[9::10] for piece in self.pieces])


class Emergency:
    """The run of a setup up to the instant of action; `roll` continues it with a pilot."""

    def __init__(self, setup: Setup, preview: bool = False):
        """Drive to the instant of action; at once with `preview`."""
        self.setup = setup
        scn = setup.scn
        self.course = RoadCoordinates(scn.reference, scn.edges)
        self._stop = inputs.stop_params(scn)
        self.car = simulation.make_car(setup)
        self._end = RunEnd(self._stop, self.car.now)
        self._tracks, self._commands = [], []
        faults = setup.faults
        self._fault_s = (faults and faults.from_s) or 0.0
        if preview or not (scn.actors or self._fault_s):
            self._tracks.append(self.car.now)
        else:
            self._drive_on()
        self.start_ns = self.car.stamp_ns

    @property
    def time_s(self) -> float:
        """The instant of action, after the start of the run."""
        return self._since_start(self.start_ns)

    @property
    def most_ticks(self) -> int:
        """The ticks from the instant of action to the time limit of the run."""
        return max(1, int(np.ceil((self._stop.time_s - self.time_s) / TICK_S)))

    def obstacles_at(self, stamp_ns: int) -> Obstacles:
        """Return the obstacles that are present at a stamp, seen or not."""
        return scenario.obstacles_at(self.setup.scn, self._since_start(stamp_ns), stamp_ns)

    def discs_at(self, stamp_ns: int) -> dict[tuple[int, int], Obstacle]:
        """Return the discs of the obstacles present at a stamp, by id and number of the disc."""
        items = self.obstacles_at(stamp_ns).items
        return {(o.id, k): disc for o in items for k, disc in enumerate(o.discs())}

    def foreseen_at(self, stamp_ns: int) -> Obstacles:
        """Return these and those that will appear, where their motion traced back puts them."""
        t = self._since_start(stamp_ns)
        ahead = (actor for actor in self.setup.scn.actors if t < actor.disappears)
        return Obstacles(stamp_ns, tuple(actors.obstacle_at(actor, t) for actor in ahead))

    def roll(self, pilot: Pilot, ticks: int | None = None) -> Rollout:
        """Let a pilot drive to the end of the run, or for so many ticks."""
        car, end = self.car.fork(), copy.copy(self._end)
        pieces, commands, outcome = [], [], None
        while outcome is None and (ticks is None or len(pieces) < ticks):
            commands.append(pilot(car, self.foreseen_at(car.stamp_ns)))
            pieces.append(car.advance(commands[-1], TICK_STEPS))
            outcome = end.check(pieces[-1])
        return Rollout(pieces, commands, outcome is not None)

    def drive(self, rollout: Rollout) -> Drive:
        """Return the whole run, the part before the action included, for the metrics."""
        pieces, commands = self._tracks + rollout.pieces, self._commands + rollout.commands
        stamps = [piece.stamp_ns[-1] for piece in pieces]
        scn = self.setup.scn
        values = {
            '/scenario/reference': [conversions.reference_as_received(scn.reference)],
            '/scenario/road_edges': [scn.edges],
            '/scenario/obstacles': [self.obstacles_at(int(stamp)) for stamp in stamps],
            '/controller/why': [],
        }
        columns = simulation.build_columns(join_trajectories(pieces), commands, values)
        return drive_from_columns(columns, simulation.run_info(self.setup), self.setup.controller)

    def _since_start(self, stamp_ns):
        return (stamp_ns - self.setup.scn.reference.stamp_ns) / NS_PER_S

    def _drive_on(self):
        """Let the controller drive until a driver can react, or the next tick ends the run."""
        is_seen = not self.setup.scn.actors
        for step in simulation.steps(self.setup):
            before = self.car, copy.copy(self._end)
            self.car = step.car.fork()
            if self._commands and self._end.check(step.track):
                self.car, self._end = before
                self._commands.pop()
                return
            self._tracks.append(step.track)
            is_seen = is_seen or bool(step.obstacles.items)
            if is_seen and self._since_start(self.car.stamp_ns) >= self._fault_s:
                return
            self._commands.append(step.record.command)
