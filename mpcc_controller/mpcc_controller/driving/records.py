"""What one tick takes, returns, and leaves to the next. SI units; stamps and instants in ns."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving.actuator_faults import ActuatorCheck, ActuatorState
from mpcc_controller.driving.choose import Candidacy, Choice
from mpcc_controller.driving.delay_compensation import SetpointRamp
from mpcc_controller.driving.fallback import Decision, Plans
from mpcc_controller.driving.friction_estimate import FrictionBelief, FrictionMemory
from mpcc_controller.driving.obstacle_prediction import Tracks
from mpcc_controller.driving.path_progress import Progress
from mpcc_controller.driving.prediction_model import TickProblem
from mpcc_controller.driving.ways import RoadAhead
from mpcc_controller.model.single_track import State
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.types import Actuators, Command, VehicleState
from stage_solver.solution import Solution
from stage_solver.stage_problem import Plan


class TickInputs(NamedTuple):
    """What one step answers, besides path, edges and obstacles."""

    state: VehicleState
    age_s: float = 0.0  # of the state when the step begins; 0 in lockstep
    # of the watchdog: no plan is computed, the car brakes; `state_stale`: after the last plan ended
    fault: str = ''
    # when the state was received, wall time; None: not known. Bags know when it was sent
    received_ns: int | None = None
    wait_s: float = 0.0  # from then to the beginning of the step
    effective_ns: int | None = None  # when the command takes effect, if known (replay)
    publish_s: float | None = None  # publishing time of the command before
    actuators: Actuators | None = None  # the newest message, to be compared with the set-points


class Attempt(NamedTuple):
    """The solutions of one tick."""

    problem: TickProblem
    solution: Solution
    plan: Plan | None  # the plan that the fallback logic chose
    warm: bool  # whether the guess was the last plan
    prepare_s: float  # s, to build the problem
    solve_s: float  # s, wall time of all solves
    plan_age: int  # ticks
    failures: int  # of the solver, in a row
    choice: Choice | None = None  # where several plans were compared; `solution` is the chosen one
    around: RoadAhead | None = None  # where there is danger
    refreshes: int | None = None  # solves with arcs taken again; None where that is off


class TickRecord(NamedTuple):
    """Everything that one step decided. The command is complete; `TickReporter` explains it."""

    inputs: TickInputs
    command: Command  # as it is sent; after an internal error not through the gate
    decision: Decision
    effective_ns: int  # when the command takes effect
    state: VehicleState  # predicted to then
    scene: Scene  # with the obstacles where they are then
    braking_line: str | None  # the line that a braking car steers along; None with a plan
    rejections: Mapping[str, int]  # by the gate since the start, by reason
    computing_s: float  # of this step
    resumed: bool  # the first step after a pause
    x0: State | None = None  # stage 0; None where no plan could be attempted
    attempt: Attempt | None = None  # None where nothing was solved
    friction: FrictionBelief | None = None  # None where it is not estimated
    actuators: ActuatorCheck | None = None  # None where nobody told where they are
    gate_reason: str = ''  # why the gate intervened, '' if it did not
    prepared_s: float | None = None  # computing time of `prepare` before this step

    def __repr__(self) -> str:
        """Return one line without arrays."""
        level, reason, _ = self.decision
        return f'TickRecord(stamp_ns={self.command.stamp_ns}, {level}: {reason}, {self.command})'


class Memory(NamedTuple):
    """What one tick leaves to the next: immutable, so a drive can be forked and wound back."""

    last: Command  # sent last, or the held actuators
    ramps: tuple[SetpointRamp, ...]  # set-points sent, the newest last
    friction: FrictionMemory | None  # None where it is not estimated
    believed: float  # friction coefficient
    actuators: ActuatorState = ActuatorState()
    tracks: Tracks = Tracks()
    planned_line: tuple[int, np.ndarray] | None = None  # of the last plan: ns; m, map
    known: VehicleState | None = None  # the last state that was finite
    is_too_slow: bool = False
    slid: bool = False  # whether the car slid in the last tick
    progress: Progress = Progress()
    plans: Plans = Plans()
    candidacy: Candidacy = Candidacy()
    solved: Attempt | None = None  # the last one
    prepared: Plan | None = None  # solution of the problem expected next
    prepared_s: float | None = None  # computing time after the last command
    computing_s: tuple[float, ...] = ()  # of the last steps
    rejections: Mapping[str, int] = MappingProxyType({})  # by the gate, by reason
    resumed: bool = False  # the next tick is the first one after a pause

    @property
    def ramp(self) -> SetpointRamp:
        """The set-points of the last command over time."""
        return self.ramps[-1]

    def command_ns(self, known_ns: int) -> int:
        """Return the delay of commands: what is known of it, and what was found besides."""
        return known_ns + self.actuators.delay.late_ns


def unknown_state(stamp_ns: int) -> VehicleState:
    """Return a state of which only the stamp is known; every other field is NaN."""
    return VehicleState(stamp_ns, *(np.nan,) * (len(VehicleState._fields) - 1))
