"""The plant as an object that is advanced: commands in, a trajectory out. No ROS, no clock."""

import copy

import numpy as np

from msgs_yaml.types import WHEELS, Actuators, Command, VehicleState
from vehicle_plant import integrator
from vehicle_plant.actuators import ActuatorFaults, DelayLine, SetPointRamp, delay_steps
from vehicle_plant.car import FaultParams, MultiBodyParams
from vehicle_plant.gate import NS_PER_S, Gate, Verdict
from vehicle_plant.initial_state import Start
from vehicle_plant.parameters import PlantParams
from vehicle_plant.state import SetPoints, Trajectory, messages

STEP_NS = round(integrator.STEP_S * NS_PER_S)
TICK_NS = 50_000_000
TICK_STEPS = TICK_NS // STEP_NS
START_NS = 1_000_000_000  # ROS takes 0 for "no time"


def model_of(params: PlantParams) -> integrator.Model:
    """Return the model that the parameters are for: the double track, or the multi-body one."""
    if isinstance(params, MultiBodyParams):
        # needs a package that a plant of its own does not
        from vehicle_plant.multi_body.equations import MULTI_BODY

        return MULTI_BODY
    return integrator.DOUBLE_TRACK


class RefusedError(ValueError):
    """The gate refuses a command."""


class Simulator:
    """The car on a road, in 1 ms steps. The same commands give the same trajectory, bit by bit."""

    def __init__(
        self,
        params: PlantParams,
        friction: float,
        start: Start,
        stamp_ns: int = START_NS,
        patches: np.ndarray | None = None,
        faults: FaultParams | None = None,
    ):
        """Initialise the car: wheels rolling freely, springs at rest, servos at zero.

        friction: road friction relative to the tyre's test surface; patches: areas of another
        friction, (k, 13) of `road_friction.patch_array`; faults: of the actuators. Raises
        ValueError when friction is not positive or the start not finite.
        """
        if not 0.0 < friction < np.inf:
            raise ValueError(f'friction is {friction}, allowed are positive numbers')
        if not np.isfinite(start).all():
            raise ValueError(f'the start is not finite: {start}')
        self._params = params
        self._model = model_of(params)
        self._p = integrator.parameter_vector(params, friction)
        self._patches = patches if patches is not None and len(patches) else None
        set_points = SetPoints(0.0, 0.0, 0.0)
        self._ramp = SetPointRamp(set_points)
        self._delays = DelayLine(delay_steps(params.car), set_points)
        self._faults = None
        if faults and any(value is not None for value in vars(faults).values()):
            self._faults = ActuatorFaults(faults, set_points, stamp_ns)
        self.gate = Gate(params, friction, set_points, stamp_ns)
        self._stamp_ns = stamp_ns
        self._x = self._model.start(params, start)
        local = self._local_parameters()
        self._row = integrator.row(self._x, np.array(set_points), local, self._model)

    @property
    def stamp_ns(self) -> int:
        """The present instant."""
        return self._stamp_ns

    @property
    def now(self) -> Trajectory:
        """The present instant as a trajectory of one row."""
        return Trajectory(np.array([self._stamp_ns]), self._row[None, :].copy())

    @property
    def state(self) -> VehicleState:
        """The present planar motion."""
        return messages(self.now.state_columns())[0]

    @property
    def actuators(self) -> Actuators:
        """The present positions of the servos."""
        return messages(self.now.actuator_columns())[0]

    def fork(self) -> 'Simulator':
        """Return a second car in the same state; either goes on without the other."""
        other = copy.copy(self)
        # the state and the row are replaced by `advance`, never changed
        other._ramp, other._delays = copy.copy(self._ramp), copy.deepcopy(self._delays)
        other._faults = copy.deepcopy(self._faults)
        other.gate = self.gate.fork()
        return other

    def command(self, command: Command, gate: Gate | None = None) -> Verdict:
        """Pass a command through the gate, or another one; it is followed if that accepts it."""
        verdict = (gate or self.gate).check(command, self._stamp_ns, TICK_NS)
        if verdict.accepted:
            due_ns = command.stamp_ns + TICK_NS - self._stamp_ns
            target = SetPoints(command.delta, command.Fxf, command.Fxr)
            self._ramp.set_target(target, due_ns // STEP_NS)
        return verdict

    def follow(self, command: Command) -> Trajectory:
        """Advance by 50 ms under a command. Raises RefusedError when it does not pass the gate."""
        verdict = self.command(command)
        if not verdict.accepted:
            raise RefusedError(f'the plant refuses the command: {verdict.reason}')
        return self.advance(None, TICK_STEPS)

    def brake_straight(self) -> None:
        """Steer straight and brake to standstill, whatever the last command was.

        The brake force is scaled by the lowest friction under a wheel at this instant.
        """
        stop = self._params.car.safe_stop
        friction = float(self._local_parameters()[-len(WHEELS) :].min())
        front, rear = (-friction * F for F in (stop.front_brake_n, stop.rear_brake_n))
        self._ramp.set_target(SetPoints(0.0, front, rear), TICK_STEPS)

    def advance(self, command: Command | None, steps: int) -> Trajectory:
        """Advance by that many milliseconds under a new command, or under the last one (None)."""
        if command is not None:
            self.command(command)
        set_points = self._delays.shift(self._ramp.advance(steps))
        stamps = self._stamp_ns + STEP_NS * np.arange(steps + 1, dtype=np.int64)
        if self._faults:
            set_points = self._faults.apply(set_points, stamps)
        x, rows = integrator.advance(
            self._x, set_points, self._p, patches=self._patches, model=self._model
        )
        if steps:
            self._row = rows[-1].copy()
            self._x = x
            self._stamp_ns = int(stamps[-1])
        return Trajectory(stamps[1:], rows)

    def _local_parameters(self) -> np.ndarray:
        """Return the parameter vector with the friction that is under each wheel now."""
        if self._patches is None:
            return self._p
        return integrator.with_local_friction(self._x, self._p, self._patches, self._model)
