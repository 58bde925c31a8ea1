"""A controller node driven tick by tick with fresh stamps, and its response to each state.

Its clock, by which it judges the age of its inputs, is set to the instant of each tick: inputs are
as fresh as in a drive, however busy the machine is.
"""

import math
from typing import NamedTuple

import node_bench
from node_bench import NodeBench

from mpcc_controller.driving import fallback
from msgs_yaml import conformance, decode, encode
from msgs_yaml.types import Actuators, Command
from node_runtime import ros
from stage_solver.solution import SOLVED, STOPPED_EARLY

# outcomes of a tick
SOLVE, FALLBACK, SILENT = 'answered by a solve', 'answered by a fallback', 'not answered'
OUTCOMES = {
    **dict.fromkeys((SOLVED, STOPPED_EARLY), SOLVE),
    **dict.fromkeys((fallback.SHIFTED, fallback.RECOVERY, fallback.BRAKING), FALLBACK),
}
ACTUATORS, COMMAND, WHY = '/vehicle/actuators', '/controller/command', '/controller/why'
LATE_NS = 10**15  # in lockstep: time goes back at each restart
BACK_NS = 10 * node_bench.TICK_NS
SILENCE_NS = 300_000_000  # without a state: beyond every limit of its age
ROUNDING = 1e-6  # relative
RECOVERY_TICKS = 10  # of valid input until a solve answers


class Answer(NamedTuple):
    """The response to a state."""

    outcome: str
    reason: str  # rung and reason, as on /controller/why
    stamp_ns: int | None  # of the state


UNANSWERED = Answer(SILENT, '', None)


class Driver:
    """Sends a controller node the inputs of a drive, tick by tick."""

    def __init__(self, bench: NodeBench):
        self.bench, self.node = bench, bench.node
        self.realtime = bench.mode == 'realtime'
        bench.bus.listeners = {COMMAND: [self.check], WHY: [self.on_why]}
        self.answer = UNANSWERED
        self.stamp_ns = LATE_NS
        self.last: Command | None = None  # that was published, None after a restart
        self.faults: list[AssertionError] = []  # of commands; the node survives what raises in it
        self.reset, self.node.controller.reset = self.node.controller.reset, self.on_reset

    def next_tick(self) -> int:
        """Begin a tick; return its stamp [ns]."""
        if self.realtime:
            bus = self.bench.bus
            bus.now_ns += node_bench.TICK_NS - bus.now_ns % node_bench.TICK_NS
            self.stamp_ns = bus.now_ns
        else:
            self.stamp_ns += node_bench.TICK_NS
        return self.stamp_ns

    def restart(self) -> None:
        """Make the controller start from the actuators at the next state.

        On the wall clock there is no state for a while, so that it brakes; in lockstep time goes
        back.
        """
        if self.realtime:
            self.bench.bus.now_ns += SILENCE_NS
            self.node.on_timer()
            self.look()
        else:
            self.stamp_ns -= BACK_NS

    def change_scene(self) -> None:
        """Forget the last state: the controller refuses a path that is far from it."""
        self.node.inputs.state = None

    def on_reset(self, actuators, resumed=False) -> None:
        """Reset the controller; its next command begins where the actuators are."""
        self.last = None
        self.reset(actuators, resumed)

    def send(self, topic: str, message) -> None:
        """Let the node hear a message or its bytes."""
        node_bench.send(self.node, topic, message)

    def send_valid(self, *but: str) -> None:
        """Send every input of the present tick except `but`; the state is the last one."""
        for topic, message in node_bench.valid_messages(self.stamp_ns).items():
            if topic not in but:
                self.send(topic, self.actuators() if topic == ACTUATORS else message)

    def actuators(self):
        """Return a valid message of actuators that do what they were asked for."""
        if self.last is None:
            return node_bench.valid_messages(self.stamp_ns)[ACTUATORS]
        _, delta, _, Fxf, Fxr = self.last
        return encode.actuators(Actuators(self.stamp_ns, delta, 0.0, Fxf, Fxr, (0.0,) * 4))

    def look(self) -> Answer:
        """Run the node's periodic check; return the last answer since the previous call.

        Raises the AssertionError of a command that was wrong.
        """
        answer, self.answer = self.answer, UNANSWERED
        self.node.on_timer()
        if self.faults:
            raise self.faults.pop(0)
        return answer

    def on_why(self, raw: bytes) -> None:
        """Store the response to a state."""
        why = decode.why(ros.deserialize(WHY, raw))
        self.answer = Answer(OUTCOMES[why.values['rung']], why.message, why.stamp_ns)

    def check(self, raw: bytes) -> None:
        """Check a command; `look` raises what is wrong."""
        try:
            self.check_command(ros.deserialize(COMMAND, raw))
        except AssertionError as fault:
            self.faults.append(fault)

    def check_command(self, message) -> None:
        """Assert that a command obeys the contract and the limits of the controller."""
        assert conformance.check(COMMAND, message) == []
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
        """Assert that a solve answers valid input again; return that answer."""
        reasons = []
        for _ in range(RECOVERY_TICKS):
            stamp_ns = self.next_tick()
            self.send_valid()
            answer = self.look()
            if answer.outcome == SOLVE and answer.stamp_ns == stamp_ns:
                return answer
            reasons.append(answer)
        raise AssertionError(f'no solve answered {len(reasons)} valid states in a row: {reasons}')


def _more(limit):
    return limit * (1 + ROUNDING)
