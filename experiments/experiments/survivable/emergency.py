"""An emergency: the instant from which a driver may act, and what happens around the car.

Until then the controller of the setup drives, without knowing what is to come. The fair instant is
the first one at which an obstacle was seen and a fault of the actuators, if there is one, began;
with full preview it is the start of the run. From then on a pilot knows all that will happen, and
the car is the plant itself.
"""

import copy
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from bags.evaluation.drive import Drive, drive_from_columns
from experiments import simulation
from experiments.configuration import inputs
from experiments.simulation import Setup
from experiments.survivable.road_coordinates import RoadCoordinates
from msgs_yaml import conversions
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Command, Obstacle, Obstacles
from scenario_publisher import actors, scenario
from vehicle_plant.run_end import RunEnd
from vehicle_plant.simulator import TICK_NS, TICK_STEPS, Simulator
from vehicle_plant.state import Trajectory, join_trajectories

TICK_S = TICK_NS / NS_PER_S
Pilot = Callable[[Simulator, Obstacles], Command]  # the car now, what will be there: a command


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
