"""The receding horizon: one state in, one command out, and why. No ROS; SI units.

A failure is a value: whatever happens inside, `step` returns a command that the gate let through.
"""

import time
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from mpcc_controller.driving import braking, commanded, explain, guide, target
from mpcc_controller.driving.ahead import Ahead
from mpcc_controller.driving.commanded import Ramp
from mpcc_controller.driving.delay import Expected
from mpcc_controller.driving.explain import Arrival
from mpcc_controller.driving.gate import UNTIMELY, Gate
from mpcc_controller.driving.guide import Aim
from mpcc_controller.driving.horizon import Horizon, Outcome
from mpcc_controller.driving.watchdog import STATE_STALE
from mpcc_controller.parameters import CarParams, ControllerParams
from mpcc_controller.path import reference, road
from mpcc_controller.problem import stages
from mpcc_controller.problem.stages import Scene
from msgs_yaml import conversions
from msgs_yaml.types import (
    Actuators,
    Command,
    Obstacles,
    Prediction,
    Reference,
    RoadEdges,
    VehicleState,
    Why,
)

NEVER = -1  # ns, older than every stamp
NOT_FINITE = 'state_not_finite'
TOO_SLOW = 'too_slow'
TURNED_BACK = 'command_turned_back'


class Controller:
    """Solves the problem of `mpcc_ocp` at every step and follows the first input of its plan.

    `limit_time` (realtime) lets the solver stop at its wall-time limit and the gate count the
    computing time, and plans from the state at which the command will take hold; without it equal
    inputs give equal commands. `clock` [s] tells durations.
    """

    def __init__(
        self,
        params: ControllerParams,
        vehicle: CarParams,
        limit_time: bool = False,
        clock: Callable[[], float] = time.perf_counter,
    ):
        self.limit_time = limit_time
        self.clock = clock
        self.horizon = Horizon(params, vehicle, limit_time, clock)
        self.params = params = self.horizon.params  # with the limits in force
        self.car = self.horizon.car
        self.gate = Gate(
            params.limits, self.car, params.model.step_s, params.fallback.max_state_age_s
        )
        self.delay = Expected(params.delay)
        self.ahead = Ahead(self.car)
        self.scene = Scene(None, None, None)
        self.publish_s: float | None = None  # what sending took last
        self.prepare_s: float | None = None  # what preparing the present step took
        self.ended = self.clock()  # the last step
        self._begin(Command(NEVER, 0.0, 0.0, 0.0, 0.0))

    def set_reference(self, path: Reference) -> str:
        """Take a path; return '' or why it was turned down (the old one stays)."""
        try:
            built = reference.build(path)
        except reference.PathError as error:
            return str(error)
        if self.scene.path is None or not reference.is_same(built, self.scene.path):
            self.scene = self.scene._replace(path=built)
            self.horizon.theta = None
        return ''

    def set_edges(self, edges: RoadEdges) -> str:
        """Take road edges; return '' or why they were turned down (the old ones stay)."""
        try:
            self.scene = self.scene._replace(road=road.build(edges))
        except road.EdgeError as error:
            return str(error)
        return ''

    def set_obstacles(self, obstacles: Obstacles) -> None:
        """Take the obstacles as of their stamp."""
        self.scene = self.scene._replace(obstacles=obstacles)

    def missing(self) -> tuple[str, ...]:
        """Return the names of what the controller has not been told yet."""
        return tuple(name for name, known in self.scene._asdict().items() if known is None)

    def reset(self, actuators: Actuators) -> None:
        """Start anew, with the set-points where the actuators are, inside their limits."""
        self._begin(commanded.where(actuators, self.params.limits, NEVER))
        self.horizon.forget()

    def _begin(self, command: Command) -> None:
        self.last = command  # sent last
        self.told = commanded.held(*commanded.end(command, self.car))
        self.too_slow = False

    def step(self, x: VehicleState, *how, **named) -> tuple[Command, Prediction, Why]:
        """Return what `answer` returns of these arguments, and what `explained` says of it."""
        command = self.answer(x, *how, **named)
        return command, *self.explained()

    def answer(
        self,
        x: VehicleState,
        age_s: float = 0.0,
        fault: str = '',
        arrival: Arrival | None = None,
        acts_ns: int | None = None,
    ) -> Command:
        """Return the command that answers a state; `explained` says why once it is sent.

        `age_s` is the age of the state when the step begins (0 in lockstep). With a `fault` of the
        watchdog no plan is made: the car brakes, for `state_stale` blindly. `arrival` says how the
        state came, where that is known; `acts_ns` is when the command takes hold, where that is
        known (replay) and need not be expected.
        """
        began = self.clock()
        params, step_s = self.params, self.params.model.step_s
        acts_ns = self._acts_ns(x, age_s) if acts_ns is None else acts_ns
        acts_on, now = self.ahead(x, self.told, acts_ns), self.told.end
        scene = stages.at_instant(self.scene, acts_ns)
        decision, tell = self._decide(acts_on, now, scene, fault)
        said = {}
        if decision.plan is None:
            command, line = self._braking(acts_on, now, scene, x.stamp_ns)
            said['guide'] = line
        else:
            goal = target.of_plan(decision.plan, self.car, params.limits)
            command = target.command(goal, now, self.car, step_s, x.stamp_ns)
        checked_s = age_s + self.clock() - began if self.limit_time else age_s
        checked = self.gate.check(command, self.last, checked_s)
        if checked.reason:
            self.horizon.ladder.distrust()
            if decision.plan is not None and checked.reason not in UNTIMELY:
                decision = self.horizon.ladder.brake(TURNED_BACK)
                braking_command, line = self._braking(acts_on, now, scene, x.stamp_ns)
                said['guide'] = line
                checked = self.gate.again(braking_command, self.last, checked_s, checked)
        self.last = checked.command
        due_ns = max(conversions.add_seconds(x.stamp_ns, step_s), acts_ns)
        self.told = Ramp(acts_ns, now, due_ns, *commanded.end(self.last, self.car))
        said |= explain.commanded(self.last, self.car, self.gate.rejections)
        lead_s = conversions.ns_to_s(acts_ns - x.stamp_ns)
        said |= explain.times(lead_s, self.publish_s, self.prepare_s) | explain.arrived(arrival)
        why = partial(explain.tick, x.stamp_ns, decision, checked.reason)
        planned = partial(explain.prediction, acts_on, decision.plan, step_s)
        self.explained = lambda: (planned(), why(tell() | said))
        self.ended = self.clock()
        if not fault:  # braking takes no time: nothing to expect of the next solve
            self.delay.took(self.ended - began)
        return self.last

    def rehearse(self, x: VehicleState, times: int) -> Iterator[tuple[Command, Prediction, Why]]:
        """Take steps for nobody from a state that stays; then forget all but what they took.

        After them code and data are in memory, and the computing time is known.
        """
        for _ in range(times):
            x = x._replace(stamp_ns=conversions.add_seconds(x.stamp_ns, self.params.model.step_s))
            yield self.step(x)
        self.horizon.forget()
        self.gate.rejections.clear()
        self.publish_s = None

    def overrule(self, command: Command) -> None:
        """Take note that `command` was sent in the place of the last answer (replay)."""
        end, lambda_b = commanded.end(command, self.car)
        self.last, self.told = command, self.told._replace(end=end, lambda_b=lambda_b)

    def published(self) -> None:
        """Take note that what the last step returned has just been sent."""
        self.publish_s = self.clock() - self.ended

    def prepare(self) -> None:
        """Solve the problem that is expected next, where `solver.prepare` says so.

        To be called once the answer of the last step has been sent: no command waits for it.
        """
        if not self.params.solver.prepare or self.missing():
            return
        began = self.clock()
        next_ns = conversions.add_seconds(self.told.begin_ns, self.params.model.step_s)
        self.horizon.prepare(stages.at_instant(self.scene, next_ns))
        self.prepare_s = self.clock() - began

    def _acts_ns(self, x, age_s) -> int:
        """Return when the command that answers `x` will take hold."""
        if not self.limit_time:
            return x.stamp_ns
        soonest = conversions.add_seconds(x.stamp_ns, self.delay.after(age_s))
        latest = conversions.add_seconds(x.stamp_ns, self.params.delay.longest_s)
        # states come a little early now and then: the set-point before is reached first
        return min(max(soonest, self.told.end_ns), latest)

    def _decide(self, x, now, scene, fault) -> Outcome:
        reason = self._obstruction(x, fault)
        if reason == NOT_FINITE:
            return Outcome(self.horizon.without_state(reason), dict)
        if reason == STATE_STALE or self.missing():
            return Outcome(self.horizon.ladder.brake(reason), dict)
        x0 = self.horizon.initial_state(x, now, scene)
        if not reason and x0.theta > scene.path.length:
            reason = 'path_ended'  # nobody said where to go from here
        plan = self.horizon.solve if not reason else partial(self.horizon.brake, reason)
        decision, tell = plan(x0, scene)
        return Outcome(decision, lambda: explain.measured(x0) | tell())

    def _obstruction(self, x, fault) -> str:
        """Return why no plan can be made at all, or ''."""
        if fault == STATE_STALE:
            return fault
        if not np.all(np.isfinite(x)):
            return NOT_FINITE
        limits = self.params.limits
        margin = limits.speed_hysteresis_mps if self.too_slow else 0.0
        self.too_slow = x.vx < limits.least_speed_mps + margin
        if self.missing():
            return f'no_{self.missing()[0]}'
        return fault or (TOO_SLOW if self.too_slow else '')

    def _braking(self, x, now, scene, stamp_ns):
        aim = self._aim(x, scene)
        goal = braking.target(x, now, aim.point, self.car, self.params)
        step_s = self.params.model.step_s
        return target.command(goal, now, self.car, step_s, stamp_ns), aim.line

    def _aim(self, x, scene) -> Aim:
        theta = None
        if scene.path is not None and np.all(np.isfinite(x)):
            theta = self.horizon.foot(x, scene)
        return guide.aim(x, self.horizon.ladder.guide, scene.path, theta, self.params.braking)


def unknown_state(stamp_ns: int) -> VehicleState:
    """Return a state of which nothing is known but its time."""
    return VehicleState(stamp_ns, *(np.nan,) * (len(VehicleState._fields) - 1))
