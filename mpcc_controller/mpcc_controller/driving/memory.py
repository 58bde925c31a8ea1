"""What one tick leaves to the next: immutable, so that a drive can be forked and wound back."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving import friction_estimate
from mpcc_controller.driving.actuator_monitor import ActuatorState
from mpcc_controller.driving.choose import Candidacy, Outcome
from mpcc_controller.driving.delay_compensation import SetpointRamp
from mpcc_controller.driving.fallback import Plans
from mpcc_controller.driving.obstacle_perception import Sightings
from mpcc_controller.driving.path_progress import Progress
from mpcc_controller.driving.prediction_model import TickProblem
from mpcc_controller.driving.ways import RoadAhead
from msgs_yaml.types import Command, VehicleState
from stage_solver.solution import Solution
from stage_solver.stage_problem import Plan


class LastSolve(NamedTuple):
    """What the last tick solved, and what it drives."""

    problem: TickProblem
    around: RoadAhead | None
    solution: Solution
    outcome: Outcome | None  # where plans were compared


@dataclass(frozen=True, eq=False)
class Memory:
    """The state of a controller between two ticks; nothing in it is changed in place."""

    last: Command  # sent last, or the held actuators
    ramps: tuple[SetpointRamp, ...]  # set-points sent, the newest last
    sightings: Sightings
    friction: friction_estimate.Memory | None  # None where it is not estimated
    believed: float  # friction coefficient
    actuators: ActuatorState = field(default_factory=ActuatorState)
    guide: tuple[int, np.ndarray] | None = None  # stamp [ns] and points [m] of the last plan, map
    known: VehicleState | None = None  # the last state that was finite
    is_too_slow: bool = False
    slid: bool = False  # whether the car slid in the last tick
    progress: Progress = field(default_factory=Progress)
    plans: Plans = field(default_factory=Plans)
    candidacy: Candidacy = field(default_factory=Candidacy)
    solved: LastSolve | None = None
    prepared: Plan | None = None  # solution of the problem expected next
    prepared_s: float | None = None  # computing time after the last command
    computing_s: tuple[float, ...] = ()  # of the last steps
    rejections: Mapping[str, int] = field(default_factory=dict)  # by the gate, by reason
    resumed: bool = False  # the next tick is the first one after a pause

    @property
    def ramp(self) -> SetpointRamp:
        """The set-points of the last command over time."""
        return self.ramps[-1]
