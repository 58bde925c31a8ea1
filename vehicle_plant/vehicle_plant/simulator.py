"""The plant as a value that is advanced: commands in, a track out. No ROS, no clock."""

from typing import NamedTuple

import numpy as np

from msgs_yaml.types import WHEELS, Actuators, Command, Imu, VehicleState, Wheels
from vehicle_plant import delay, graph, named, stepper
from vehicle_plant.delay import DelayLine
from vehicle_plant.gate import NS_PER_S, Gate, Verdict
from vehicle_plant.parameters import PlantParams
from vehicle_plant.set_points import Ramp
from vehicle_plant.state import SetPoints, State
from vehicle_plant.track import Track

STEP_NS = round(graph.STEP_S * NS_PER_S)
TICK_NS = 50_000_000
TICK_STEPS = TICK_NS // STEP_NS
START_NS = 1_000_000_000  # ROS takes 0 for "no time"


class Start(NamedTuple):
    """Where the car is at the start, rolling straight ahead."""

    X: float  # m, map
    Y: float  # m, map
    psi: float  # rad, map
    speed: float  # m/s


class Simulator:
    """The car on a road, in 1 ms steps. The same commands give the same track, bit by bit."""

    def __init__(
        self,
        params: PlantParams,
        friction: float,
        start: Start,
        stamp_ns: int = START_NS,
        patches: np.ndarray | None = None,
    ):
        """Put the car at its start: wheels rolling freely, springs at rest, servos at zero.

        friction: road friction over that of the tyre's test surface; patches: where it differs,
        (k, 13) of `road.patches`. Raises ValueError when friction is not positive, or the start
        not finite.
        """
        if not 0.0 < friction < np.inf:
            raise ValueError(f'friction is {friction}, allowed are positive numbers')
        if not np.isfinite(start).all():
            raise ValueError(f'the start is not finite: {start}')
        self._params = params
        self._p = graph.parameter_vector(params, friction)
        self._patches = patches if patches is not None and len(patches) else None
        held = SetPoints(0.0, 0.0, 0.0)
        self._ramp = Ramp(held)
        self._delays = DelayLine(delay.of(params.car), held)
        self.gate = Gate(params, friction, held, stamp_ns)
        self._stamp_ns = stamp_ns
        self._x = trimmed(params, start)
        derivative, _ = graph.functions()
        readings = derivative(self._x, np.array(held), self._under())[1]
        self._row = np.concatenate([self._x, np.asarray(readings).ravel()])

    @property
    def stamp_ns(self) -> int:
        """The present instant."""
        return self._stamp_ns

    @property
    def now(self) -> Track:
        """The present instant as a track of one row."""
        return Track(np.array([self._stamp_ns]), self._row[None, :].copy())

    @property
    def state(self) -> VehicleState:
        """The present planar motion."""
        return self.now.states()[0]

    @property
    def actuators(self) -> Actuators:
        """The present position of the servos."""
        return self.now.actuators()[0]

    @property
    def imu(self) -> Imu:
        """The present accelerations."""
        return self.now.imu()[0]

    @property
    def wheels(self) -> Wheels:
        """The present state of the wheels."""
        return self.now.wheels()[0]

    def command(self, command: Command) -> Verdict:
        """Offer a command to the gate; one that passes is followed from now on."""
        verdict = self.gate.check(command, self._stamp_ns, TICK_NS)
        if verdict.accepted:
            due_ns = command.stamp_ns + TICK_NS - self._stamp_ns
            target = SetPoints(command.delta, command.Fxf, command.Fxr)
            self._ramp.aim(target, due_ns // STEP_NS)
        return verdict

    def brake_straight(self) -> None:
        """Steer straight and brake to standstill, whatever the last command was.

        As hard as the most slippery place under a wheel allows now.
        """
        stop = self._params.car.safe_stop
        friction = float(self._under()[-len(WHEELS) :].min())
        front, rear = (-friction * F for F in (stop.front_brake_n, stop.rear_brake_n))
        self._ramp.aim(SetPoints(0.0, front, rear), TICK_STEPS)

    def advance(self, command: Command | None, steps: int) -> Track:
        """Advance by that many milliseconds under a new command, or under the last one (None)."""
        if command is not None:
            self.command(command)
        set_points = self._delays.take(self._ramp.take(steps))
        rows = stepper.advance(self._x, set_points, self._p, patches=self._patches)
        stamps = self._stamp_ns + STEP_NS * np.arange(1, steps + 1, dtype=np.int64)
        if steps:
            self._row = rows[-1].copy()
            self._x = self._row[: self._x.size]
            self._stamp_ns = int(stamps[-1])
        return Track(stamps, rows)

    def _under(self) -> np.ndarray:
        """Return the numbers of the plant with the friction under each wheel now at their end."""
        if self._patches is None:
            return self._p
        return graph.gripping(self._x, self._p, self._patches)


def trimmed(params: PlantParams, start: Start) -> np.ndarray:
    """Return the flat state of a car that rolls straight ahead without slip."""
    x = dict.fromkeys(named.names(State), 0.0)
    x |= {
        'planar.X': start.X,
        'planar.Y': start.Y,
        'planar.psi': start.psi,
        'planar.vx': start.speed,
    }
    for w in WHEELS:
        x[f'wheels.{w}.omega'] = start.speed / params.car.wheel.radius_m
        x[f'wheels.{w}.windup'] = float(np.sign(start.speed))
    return np.array(list(x.values()))
