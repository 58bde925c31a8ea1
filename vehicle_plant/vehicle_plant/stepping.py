"""When the plant advances, and what happens when the controller is silent. No ROS, no clock.

Lockstep: a burst of 50 steps per command, as long as commands come. Realtime: steps follow the wall
clock. In both, the last command of a silent controller is held for two ticks, then the car follows
the plan that came with it (`SilentStop`), and after that brakes straight to standstill. Time is an
argument.
"""

from collections import deque
from collections.abc import Callable

import numpy as np

from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.decode import DecodeError
from msgs_yaml.types import Command, StopPlan
from node_runtime.input_monitor import ERROR, InputMonitor
from vehicle_plant.run_end import CONTROLLER_GONE, Outcome, RunEnd
from vehicle_plant.simulator import STEP_NS, TICK_NS, TICK_STEPS, Simulator
from vehicle_plant.state import Trajectory, join_trajectories

HELD_TICKS = 2
HELD_S = HELD_TICKS * TICK_NS / 1e9
ANSWERABLE_STATES = 100  # last states of a car held at its start: 2 s
# what the car does while the controller is silent
HOLDING = 'no command comes, holding the last one'
FOLLOWING = 'no command comes, stopping along the last plan'
BRAKING = 'no command comes, braking straight'
CHECKED_STEPS = 10  # between two checks of the end of the run, which cost as much as two steps


class SilentStop:
    """Stops a car whose controller is silent: along the plan of its last command, then straight.

    `read_plan` returns the newest plan; it raises DecodeError for one that breaks the contract.
    """

    def __init__(self, car: Simulator):
        self._car = car
        self.read_plan: Callable[[], StopPlan] | None = None
        self._plan: StopPlan | None = None  # that is followed
        self._gate = car.gate  # of its set-points
        self._steps_left = 0  # until the next ones
        self.message = HOLDING

    def begin(self) -> None:
        """Follow the newest plan from now on, if it belongs to the command accepted last."""
        # a gate of its own: a controller that returns answers a state a little older than now
        self._gate, self._steps_left = self._car.gate.fork(), 0
        self._plan, refused = None, ''
        try:
            self._plan = self.read_plan() if self.read_plan else None
        except DecodeError as error:
            refused = str(error)
        self.message = FOLLOWING
        if self._plan is None or self._plan.stamp_ns != self._gate.stamp_ns:
            self._brake(refused)

    def next_steps(self, most: int) -> int:
        """Return how many steps, `most` or fewer, the car takes under the present set-points.

        Where those of a plan are reached these are its next ones. Past its end, or where the gate
        refuses them, the car brakes straight.
        """
        if not self._steps_left:
            self._steps_left = TICK_STEPS
            if self._plan is not None:
                self._follow(self._plan)
        steps = min(most, self._steps_left)
        self._steps_left -= steps
        return steps

    def _follow(self, plan):
        now_ns = self._car.stamp_ns
        t = (now_ns + TICK_NS - plan.stamp_ns) / NS_PER_S
        if t > plan.t[-1]:
            self._brake()
            return
        delta, Fxf, Fxr = (float(np.interp(t, plan.t, joint)) for joint in plan[2:])
        verdict = self._car.command(Command(now_ns, delta, 0.0, Fxf, Fxr), self._gate)
        if not verdict.accepted:
            self._brake(verdict.reason)

    def _brake(self, refused=''):
        self._plan = None
        self._car.brake_straight()
        self.message = f'{BRAKING}, the plan is refused: {refused}' if refused else BRAKING


class LockstepStepper:
    """Simulated time: advances a tick when the command for the present instant has come."""

    missed_steps = 0  # none can be missed: time waits
    longest_gap = 1

    def __init__(self, car: Simulator, end: RunEnd):
        self.car, self.stop = car, SilentStop(car)
        self._end = end
        self._silent_ticks = 0
        self.controller_gone = False
        self.outcome: Outcome | None = None

    def is_due(self, stamp_ns: int) -> bool:
        """Return whether a command with this stamp is the next one."""
        return stamp_ns == self.car.stamp_ns and not self.controller_gone and self.outcome is None

    def tick(self, command: Command | None) -> Trajectory:
        """Advance 50 ms under a command; None stands for an unreadable one."""
        trajectory = self.car.advance(command, TICK_STEPS)
        self.outcome = self._end.check(trajectory)
        return trajectory

    def tick_without_controller(self) -> Trajectory:
        """Advance 50 ms without a command: from now on the controller counts as gone."""
        self.controller_gone = True
        if self._silent_ticks == HELD_TICKS:
            self.stop.begin()
        self._silent_ticks += 1
        trajectory = self.car.advance(None, self.stop.next_steps(TICK_STEPS))
        self._end.check(trajectory)
        if self._end.standing:
            self.outcome = Outcome(CONTROLLER_GONE, 'the controller is gone', self.car.stamp_ns)
        return trajectory


class StartHold:
    """Wall time before a run: the car is held at its start until a command answers it."""

    def __init__(self):
        self._published_ns = deque(maxlen=ANSWERABLE_STATES)

    def record(self, stamp_ns: int) -> None:
        """Record the stamp of a published start."""
        self._published_ns.append(stamp_ns)

    def is_answer(self, command: Command) -> bool:
        """Return whether a command answers one of the last published states."""
        return command.stamp_ns in self._published_ns


class RealtimeStepper:
    """Wall time: advances by as many steps as are due.

    A command ages from the instant at which it is due, one tick after its stamp; after `limit_s`
    the car stops. A controller that returns is followed again.
    """

    def __init__(self, car: Simulator, end: RunEnd, limit_s: float = HELD_S):
        self.car, self.stop = car, SilentStop(car)
        self.start_ns = car.stamp_ns
        self.command_monitor = InputMonitor('command', limit_s)
        self.command_monitor.record(car.stamp_ns + TICK_NS)
        self._end = end
        self._unchecked: list[Trajectory] = []
        self.controller_gone = False
        self.missed_steps = 0
        self.longest_gap = 1
        self.outcome: Outcome | None = None

    def command(self, command: Command) -> None:
        """Follow a command that passes the gate."""
        if self.car.command(command).accepted:
            self.command_monitor.record(command.stamp_ns + TICK_NS)
            self.controller_gone = False
        else:
            self.command_monitor.reject(self.car.gate.last_reason)

    def reject(self, reason: str) -> None:
        """Count an unreadable command; the last valid one stands."""
        self.car.gate.reject(reason)
        self.command_monitor.reject(reason)

    def advance_to(self, now_ns: int) -> Trajectory | None:
        """Advance by all steps that are due at now_ns; None when there are none.

        More than one means that steps are late: they are counted and caught up here, up to the end
        of the run at most: after minutes of suspension the car is at rest.
        """
        due = (now_ns - self.car.stamp_ns) // STEP_NS
        if due <= 0 or self.outcome:
            return None
        self.longest_gap = max(self.longest_gap, due)
        if self.command_monitor.update(now_ns) == ERROR and not self.controller_gone:
            self.controller_gone = True
            self.stop.begin()
        pieces = []
        while due > 0 and not self.outcome:
            # no ramp of set-points is longer than a tick: such pieces have the bits of the whole
            steps = min(due, TICK_STEPS)
            if self.controller_gone:
                steps = self.stop.next_steps(steps)
            pieces.append(self.car.advance(None, steps))
            due -= steps
            self._check_end(pieces[-1])
        trajectory = join_trajectories(pieces)
        self.missed_steps += len(trajectory.rows) - 1
        return trajectory

    def _check_end(self, piece: Trajectory) -> None:
        self._unchecked.append(piece)
        if sum(len(unchecked.rows) for unchecked in self._unchecked) < CHECKED_STEPS:
            return
        self.outcome = self._end.check(join_trajectories(self._unchecked))
        self._unchecked = []
        if self.controller_gone and self._end.standing:
            self.outcome = Outcome(CONTROLLER_GONE, 'the controller is gone', self.car.stamp_ns)
