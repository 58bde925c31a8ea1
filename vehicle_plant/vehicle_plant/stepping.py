"""The plant's side of the ring: when to advance, and what happens when the controller is silent.

Lockstep: a burst of 50 steps per command, as long as commands come. Realtime: steps follow the wall
clock. In both, a silent controller's last command is held for two ticks, then the car brakes
straight. No ROS, no clock: time is an argument.
"""

from collections import deque

from msgs_yaml.types import Command
from node_runtime.input_monitor import ERROR, InputMonitor
from vehicle_plant.run_end import CONTROLLER_GONE, Outcome, RunEnd
from vehicle_plant.simulator import STEP_NS, TICK_NS, TICK_STEPS, Simulator
from vehicle_plant.state import Trajectory, join_trajectories

HELD_TICKS = 2
HELD_STATES = 100  # of the start, that may still be answered: 2 s
HELD_S = HELD_TICKS * TICK_NS / 1e9
WATCHED_STEPS = 10  # at once: a look costs as much as two steps


class LockstepStepper:
    """Simulated time: advances a tick when the command for the present instant has come."""

    def __init__(self, car: Simulator, end: RunEnd):
        self.car = car
        self._end = end
        self._silent_ticks = 0
        self.gone = False
        self.missed_steps = 0  # none can be missed: time waits
        self.longest_gap = 1
        self.outcome: Outcome | None = None

    def answers(self, stamp_ns: int) -> bool:
        """Return whether a command with this stamp is the one waited for."""
        return stamp_ns == self.car.stamp_ns and not self.gone and self.outcome is None

    def tick(self, command: Command | None) -> Trajectory:
        """Advance 50 ms under a command; None stands for one that could not be read."""
        track = self.car.advance(command, TICK_STEPS)
        self.outcome = self._end.watch(track)
        return track

    def tick_alone(self) -> Trajectory:
        """Advance 50 ms without a controller: from now on it counts as gone."""
        self.gone = True
        if self._silent_ticks == HELD_TICKS:
            self.car.brake_straight()
        self._silent_ticks += 1
        track = self.car.advance(None, TICK_STEPS)
        self._end.watch(track)
        if self._end.standing:
            self.outcome = Outcome(CONTROLLER_GONE, 'the controller is gone', self.car.stamp_ns)
        return track


class StartHold:
    """Wall time before a run: the car stands at its start until a command answers it."""

    def __init__(self):
        self._sent_ns = deque(maxlen=HELD_STATES)

    def sent(self, stamp_ns: int) -> None:
        """Take the stamp under which the start was sent."""
        self._sent_ns.append(stamp_ns)

    def is_answer(self, command: Command) -> bool:
        """Tell whether a command answers one of the last states; a blind one does not."""
        return command.stamp_ns in self._sent_ns


class RealtimeStepper:
    """Wall time: advances by as many steps as are due.

    A command ages from the instant at which it is due, one tick after its stamp; `limit_s` is how
    long it is held.
    """

    def __init__(self, car: Simulator, end: RunEnd, limit_s: float = HELD_S):
        self.car = car
        self.began_ns = car.stamp_ns
        self.watch = InputMonitor('command', limit_s)
        self.watch.record(car.stamp_ns + TICK_NS)
        self._end = end
        self._unwatched: list[Trajectory] = []
        self.gone = False
        self.missed_steps = 0
        self.longest_gap = 1
        self.outcome: Outcome | None = None

    def command(self, command: Command) -> None:
        """Follow a command; a silent controller that speaks again is followed again."""
        if self.car.command(command).accepted:
            self.watch.record(command.stamp_ns + TICK_NS)
            self.gone = False
        else:
            self.watch.reject(self.car.gate.last_reason)

    def refuse(self, reason: str) -> None:
        """Count a command that could not be read; the last good one stands."""
        self.car.gate.refuse(reason)
        self.watch.reject(reason)

    def advance_to(self, now_ns: int) -> Trajectory | None:
        """Advance by all steps that are due at now_ns; None when there are none.

        More than one means that steps came late: they are counted, and caught up here, as far as
        the run goes: a process that was stopped for minutes finds its car long at rest.
        """
        due = (now_ns - self.car.stamp_ns) // STEP_NS
        if due <= 0 or self.outcome:
            return None
        self.longest_gap = max(self.longest_gap, due)
        if self.watch.update(now_ns) == ERROR and not self.gone:
            self.gone = True
            self.car.brake_straight()
        pieces = []
        while due > 0 and not self.outcome:
            # no ramp of set-points is longer than a tick: such pieces have the bits of the whole
            pieces.append(self.car.advance(None, min(due, TICK_STEPS)))
            due -= TICK_STEPS
            self._watch(pieces[-1])
        track = join_trajectories(pieces)
        self.missed_steps += len(track.rows) - 1
        return track

    def _watch(self, track: Trajectory) -> None:
        self._unwatched.append(track)
        if sum(len(piece.rows) for piece in self._unwatched) < WATCHED_STEPS:
            return
        self.outcome = self._end.watch(join_trajectories(self._unwatched))
        self._unwatched = []
        if self.gone and self._end.standing:
            self.outcome = Outcome(CONTROLLER_GONE, 'the controller is gone', self.car.stamp_ns)
