"""The receding horizon: one state in, one command out, and why. No ROS; SI units.

A failure is a value: whatever happens inside, `step` returns a command that the gate let through.
"""

import time
from collections.abc import Callable

import numpy as np

from mpcc_controller import ahead, explain, reference, road, target
from mpcc_controller.gate import Gate
from mpcc_controller.horizon import Horizon, Outcome
from mpcc_controller.parameters import CarParams, ControllerParams
from mpcc_controller.shooting import Plan
from mpcc_controller.single_track import State
from mpcc_controller.stages import Scene
from mpcc_controller.target import SetPoints
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
        self.params = params
        self.limit_time = limit_time
        self.clock = clock
        self.horizon = Horizon(params, vehicle, limit_time, clock)
        self.car = self.horizon.car
        self.gate = Gate(
            params.limits, self.car, params.model.step_s, params.fallback.max_state_age_s
        )
        lead_s = params.solver.lead_s if limit_time else 0.0
        self.ahead = ahead.make(self.car, lead_s)
        self.scene = Scene(None, None, None)
        self.last = Command(NEVER, 0.0, 0.0, 0.0, 0.0)  # sent last; its end is the set-point now
        self.too_slow = False

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
        limits = self.params.limits
        force = actuators.Fxf + actuators.Fxr
        share = np.clip(force, -limits.brake_n, limits.drive_n) / force if force else 0.0
        if actuators.Fxf * actuators.Fxr < 0:
            share = 0.0
        self.last = Command(
            stamp_ns=NEVER,
            delta=float(np.clip(actuators.delta, -limits.steer_rad, limits.steer_rad)),
            d_delta=0.0,
            Fxf=float(share * actuators.Fxf),
            Fxr=float(share * actuators.Fxr),
        )
        self.too_slow = False
        self.horizon.forget()

    def step(self, x: VehicleState, age_s: float = 0.0) -> tuple[Command, Prediction, Why]:
        """Return the command that answers a state, the plan, and why.

        `age_s` is the age of the state when the step begins (0 in lockstep).
        """
        began = self.clock()
        now = SetPoints(self.last.delta, self.last.Fxf + self.last.Fxr)
        acts_on = self.ahead(x, now)
        decision, said = self._decide(acts_on, now)
        step_s = self.params.model.step_s
        if decision.plan is None:
            goal = target.braking(x, now, self.car, self.params.limits, step_s)
        else:
            goal = target.of_plan(decision.plan, self.car, self.params.limits)
        command = target.command(goal, now, self.car, step_s, x.stamp_ns)
        if self.limit_time:
            age_s += self.clock() - began
        self.last, turned_back = self.gate.check(command, self.last, age_s)
        if turned_back:
            self.horizon.ladder.brake(turned_back)
        said |= explain.commanded(self.last, self.car, sum(self.gate.rejections.values()))
        why = explain.tick(x.stamp_ns, decision, turned_back, said)
        return self.last, _prediction(acts_on, decision.plan, step_s), why

    def _decide(self, x, now) -> Outcome:
        reason = self._obstruction(x)
        if reason:
            return Outcome(self.horizon.ladder.brake(reason), {})
        x0 = self.horizon.initial_state(x, now, self.scene)
        decision, said = self.horizon.solve(x0, self.scene)
        return Outcome(decision, explain.measured(x0) | said)

    def _obstruction(self, x) -> str:
        """Return why no plan can be made at all, or ''."""
        if not np.all(np.isfinite(x)):
            return 'state_not_finite'
        limits = self.params.limits
        margin = limits.speed_hysteresis_mps if self.too_slow else 0.0
        self.too_slow = x.vx < limits.least_speed_mps + margin
        if self.missing():
            return f'no_{self.missing()[0]}'
        return 'too_slow' if self.too_slow else ''


def _prediction(x: VehicleState, plan: Plan | None, step_s: float) -> Prediction:
    """Return the planned poses; without a plan only the present one."""
    if plan is None:
        return Prediction(x.stamp_ns, *(np.array([value]) for value in (x.X, x.Y, x.psi, 0.0)))
    states = State(*plan.X.T)
    t = step_s * np.arange(len(plan.X))
    return Prediction(x.stamp_ns, states.X, states.Y, states.psi, t)
