"""When the plant advances, and what happens when the controller is silent. No ROS, no clock.

Lockstep: a burst of 50 steps per command, as long as commands come. Realtime: steps follow the wall
clock. In both, the last command of a silent controller is held for as long as the contract says,
then the car follows the plan that came with it (`SilentStop`), and after that brakes straight to
standstill. Time is an argument.
"""

from collections.abc import Callable

import numpy as np

from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.decode import DecodeError
from msgs_yaml.types import Command, StopPlan
from node_runtime.input_monitor import ERROR, InputMonitor
from vehicle_plant.gate import COMMAND, HELD_TICKS, OLDEST_TICKS
from vehicle_plant.run_end import CONTROLLER_GONE, Outcome, RunEnd
from vehicle_plant.simulator import STEP_NS, TICK_NS, TICK_STEPS, Simulator
from vehicle_plant.state import Trajectory, join_trajectories

# from a command until a plan begins that is made for when it takes effect: so old it may be when it
# comes; then it is due and held, and the first set-points of the plan are due a tick later
LATEST_NS = (OLDEST_TICKS + 1 + HELD_TICKS + 1) * TICK_NS
# what the car does while the controller is silent
HOLDING = 'no command comes, holding the last one'
FOLLOWING = 'no command comes, stopping along the last plan'
BRAKING = 'no command comes, braking straight'
CHECKED_STEPS = 10  # between two checks of the end of the run, which cost as much as two steps


class SilentStop:
    """Stops a car whose controller is silent: along the plan of its last command, then straight."""

    def __init__(self, car: Simulator):
        self._car = car
        self._kept: dict[int, Callable[[], StopPlan]] = {}
        self._start: tuple[int, int] = (0, 0)
        self._plan: StopPlan | None = None  # that is followed
        self._gate = car.gate  # of its set-points
        self._steps_left = 0  # until the next ones
        self.message = HOLDING

    def restamp(self, stamp_ns: int, start_ns: int) -> None:
        """Take the plan with this stamp, that of the first command, as one of the start."""
        self._start = stamp_ns, start_ns

    def keep(self, stamp_ns: int, read_plan: Callable[[], StopPlan]) -> None:
        """Keep the plan with a stamp, beside that of the command accepted last.

        `read_plan` returns it when it is needed; it raises DecodeError for one that breaks the
        contract. The command of the plan may yet come, or be refused.
        """
        accepted_ns, (sent_ns, start_ns) = self._car.gate.stamp_ns, self._start
        self._kept = {ns: read for ns, read in self._kept.items() if ns == accepted_ns}
        self._kept[start_ns if stamp_ns == sent_ns else stamp_ns] = read_plan

    def begin(self) -> None:
        """Follow the plan of the command accepted last from now on, once it is due."""
        # a gate of its own: a controller that returns answers a state a little older than now
        self._gate, self._steps_left = self._car.gate.fork(), 0
        self._plan, stamp_ns = None, self._gate.stamp_ns
        self.message = HOLDING
        if stamp_ns not in self._kept:
            self._brake()
            return
        try:
            plan = self._kept[stamp_ns]()._replace(stamp_ns=stamp_ns)
        except DecodeError as error:
            self._brake(str(error))
            return
        begin_ns = round(plan.t[0] * NS_PER_S)
        if begin_ns > LATEST_NS:
            begin_s, latest_s = begin_ns / NS_PER_S, LATEST_NS / NS_PER_S
            self._brake(f'it begins {begin_s:g} s after its command, allowed up to {latest_s:g} s')
            return
        wait_ns = stamp_ns + begin_ns - TICK_NS - self._car.stamp_ns
        self._plan, self._steps_left = plan, max(-(-wait_ns // STEP_NS), 0)

    def advance(self, steps: int) -> Trajectory:
        """Advance the car by some steps.

        It holds the command until the plan is due and then has its set-points, passed every tick;
        past their end, or where the gate refuses them, it brakes straight.
        """
        pieces = []
        while steps > 0:
            if not self._steps_left:
                self._steps_left = TICK_STEPS
                if self._plan is not None:
                    self._follow(self._plan)
            piece = min(steps, self._steps_left)
            pieces.append(self._car.advance(None, piece))
            self._steps_left -= piece
            steps -= piece
        return join_trajectories(pieces)

    def _follow(self, plan):
        now_ns, self.message = self._car.stamp_ns, FOLLOWING
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
        trajectory = self.stop.advance(TICK_STEPS)
        self.outcome = self._end.check(trajectory)
        if self._end.standing:
            self.outcome = Outcome(CONTROLLER_GONE, 'the controller is gone', self.car.stamp_ns)
        return trajectory


class RealtimeStepper:
    """Wall time: advances by as many steps as are due.

    A command ages from the instant at which it is due, one tick after its stamp; after `limit_s`
    the car stops. A controller that returns is followed again.
    """

    def __init__(self, car: Simulator, end: RunEnd, limit_s: float = COMMAND.held_s):
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

    def start(self, command: Command) -> None:
        """Follow the first command, which answers the held start, as one of the start of the run.

        Its plan counts from there, too.
        """
        self.stop.restamp(command.stamp_ns, self.start_ns)
        self.command(command._replace(stamp_ns=self.start_ns))

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
            gone = self.controller_gone
            pieces.append(self.stop.advance(steps) if gone else self.car.advance(None, steps))
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
