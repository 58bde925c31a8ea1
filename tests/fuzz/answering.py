"""A controller node driven tick by tick with fresh stamps, and how it answers each state.

The clock of the node, by which it judges the age of its inputs, is set to the instant of each tick:
inputs are as fresh as in a drive however busy the machine is, and nobody waits for the next tick.
The time limits of the solvers remain those of the real clock.
"""

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import nodes
from nodes import Bench

from mpcc_controller.driving import fallback
from msgs_yaml import conformance, decode
from msgs_yaml.types import Command
from node_runtime import ros, scheduling
from stage_solver.solution import SOLVED, STOPPED_EARLY

# outcomes of a tick
SOLVE, FALLBACK, SILENT = 'answered by a solve', 'answered by a fallback', 'not answered'
OUTCOMES = {
    **dict.fromkeys((SOLVED, STOPPED_EARLY, fallback.SECOND_SOLVER), SOLVE),
    **dict.fromkeys((fallback.SHIFTED, fallback.BRAKING), FALLBACK),
}
LATE_NS = 10**15  # in lockstep: time goes back at each restart
BACK_NS = 10 * nodes.TICK_NS
SILENCE_NS = 300_000_000  # without a state: beyond every limit of its age
ROUNDING = 1e-6  # relative
# of sound input until a solve answers; on the wall clock a busy machine takes the solver's time
MOST_RECOVERY_TICKS = {'lockstep': 10, 'realtime': 100}
PRIORITY = 20  # of SCHED_FIFO, where the user may


class Clock:
    """The wall time of a node: begins with the real one, then stands unless it is moved."""

    def __init__(self, wall):
        self.instant_ns = wall.now_ns()
        wall.now_ns = lambda: self.instant_ns

    def advance(self, duration_ns: int) -> None:
        """Set the clock forward."""
        self.instant_ns += duration_ns


@contextmanager
def punctual(mode: str) -> Iterator[None]:
    """Give this process real-time priority for a test on the wall clock, where the user may."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    if mode == 'realtime':
        scheduling.apply(replace(scheduling.DEFAULTS, priority=PRIORITY))
    try:
        yield
    finally:
        for thread in Path('/proc/self/task').iterdir():
            with suppress(ProcessLookupError):
                os.sched_setscheduler(int(thread.name), *before)


class Heard:
    """A publisher whose messages are also given to somebody who looks at them."""

    def __init__(self, publisher, look):
        self.publisher, self.look = publisher, look

    def publish(self, message) -> None:
        """Look at a message and publish it."""
        self.look(message)
        self.publisher.publish(message)


class Answer(NamedTuple):
    """How a state was answered."""

    outcome: str
    reason: str  # rung and reason, as on /controller/why
    stamp_ns: int | None  # of the state


UNANSWERED = Answer(SILENT, '', None)


class Driver:
    """Tells a controller node what a ring would, one tick after the other."""

    def __init__(self, bench: Bench):
        self.bench, self.node = bench, bench.node
        self.realtime = bench.mode == 'realtime'
        self.clock = Clock(self.node.wall)
        self.node.command_pub = Heard(self.node.command_pub, self.check)
        self.node.why_pub = Heard(self.node.why_pub, self.on_why)
        self.answer = UNANSWERED
        # a controller brakes for a vehicle whose states stop, not where there is none
        self.vehicle = ros.publisher(bench.listener, '/vehicle/odometry')
        self.stamp_ns = LATE_NS
        self.last: Command | None = None  # that was published, None after a restart
        self.reset, self.node.controller.reset = self.node.controller.reset, self.on_reset

    def next_tick(self) -> int:
        """Begin a tick; return its stamp [ns]."""
        if self.realtime:
            now_ns = self.clock.instant_ns
            self.clock.advance(nodes.TICK_NS - now_ns % nodes.TICK_NS)
            self.stamp_ns = self.clock.instant_ns
        else:
            self.stamp_ns += nodes.TICK_NS
        return self.stamp_ns

    def restart(self) -> None:
        """Make the controller start from the actuators at the next state.

        On the wall clock no state comes for a while, and it brakes blindly; in lockstep time goes
        back.
        """
        if self.realtime:
            self.clock.advance(SILENCE_NS)
            self.node.on_timer()
            self.look()
        else:
            self.stamp_ns -= BACK_NS

    def on_reset(self, actuators) -> None:
        """Reset the controller; its next command begins where the actuators are."""
        self.last = None
        self.reset(actuators)

    def tell(self, topic: str, message) -> None:
        """Call the callback of a topic with a message or its bytes."""
        raw = message if isinstance(message, bytes) else ros.serialize(message)
        nodes.hearing(self.node, topic).callback(raw)

    def tell_sound(self, *but: str) -> None:
        """Tell every input of the present tick, but for some topics; the state comes last."""
        for topic, message in nodes.sound(self.stamp_ns).items():
            if topic not in but:
                self.tell(topic, message)

    def look(self) -> Answer:
        """Let the node look at the time; return the last answer since the call before."""
        answer, self.answer = self.answer, UNANSWERED
        self.node.on_timer()
        self.bench.drain()
        return answer

    def on_why(self, message) -> None:
        """Note how a state was answered."""
        why = decode.why(message)
        self.answer = Answer(OUTCOMES[why.values['rung']], why.message, why.stamp_ns)

    def check(self, message) -> None:
        """Assert that a command keeps the contract and the limits of the controller."""
        assert conformance.check('/controller/command', message) == []
        new, last, limits = decode.command(message), self.last, self.node.params.limits
        assert all(map(math.isfinite, new[1:])), new
        force = new.Fxf + new.Fxr
        assert abs(new.delta) <= _more(limits.steer_rad), new
        assert -_more(limits.brake_n) <= force <= _more(limits.drive_n), new
        if last is not None and new.stamp_ns > last.stamp_ns:
            step_s = self.node.params.model.step_s
            turn, push = abs(new.delta - last.delta), abs(force - last.Fxf - last.Fxr)
            assert turn <= _more(limits.steer_rate_radps) * step_s, (new, last)
            assert push <= _more(limits.force_rate_nps) * step_s, (new, last)
        self.last = new

    def recover(self) -> Answer:
        """Assert that a solve answers sound input again; return that answer."""
        reasons = []
        for _ in range(MOST_RECOVERY_TICKS[self.bench.mode]):
            stamp_ns = self.next_tick()
            self.tell_sound()
            answer = self.look()
            if answer.outcome == SOLVE and answer.stamp_ns == stamp_ns:
                return answer
            reasons.append(answer)
        raise AssertionError(f'no solve answered {len(reasons)} sound states in a row: {reasons}')


def _more(limit):
    return limit * (1 + ROUNDING)
