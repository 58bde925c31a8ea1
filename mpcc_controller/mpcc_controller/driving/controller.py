"""The receding-horizon controller: one state in, one command out. No ROS; SI units.

A failure is a value: whatever fails inside, `step` returns a command that passed the gate.
"""

import time
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from mpcc_controller import minimum_speed, run_time_parameters
from mpcc_controller.driving import (
    braking,
    friction_estimate,
    measurement_errors,
    recovery,
    setpoints,
    warm_up_scene,
)
from mpcc_controller.driving.braking import LookaheadPoint
from mpcc_controller.driving.delay_compensation import (
    LatencyEstimator,
    SetpointRamp,
    StatePredictor,
    constant_ramp,
    still_needed,
)
from mpcc_controller.driving.fallback import RECOVERY
from mpcc_controller.driving.friction_estimate import FrictionBelief
from mpcc_controller.driving.gate import UNTIMELY, Gate
from mpcc_controller.driving.obstacle_perception import ObstaclePerception
from mpcc_controller.driving.planner import Planner
from mpcc_controller.driving.tick import TickInputs, TickRecord, unknown_state
from mpcc_controller.driving.tick_report import TickReporter
from mpcc_controller.driving.watchdog import STATE_STALE
from mpcc_controller.parameters import CarParams, ControllerParams
from mpcc_controller.path import reference_path, road_edges
from mpcc_controller.problem import stage_parameters
from mpcc_controller.problem.stage_parameters import Scene
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
from node_runtime.parameters import ParameterError

NEVER_NS = -1  # older than every stamp
EMERGENCIES = 5  # of the steps that warm up
NOT_FINITE = 'state_not_finite'
TOO_SLOW = 'too_slow'
REJECTED = 'command_turned_back'  # by the gate


class Controller:
    """Plans at every step and commands the first input of the plan.

    Inputs are set by `set_reference`, `set_edges`, `set_obstacles` and `reset`; `step` answers a
    state. `limit_time` (realtime) lets the solvers stop at their wall-time limits, plans from the
    state at which the command will take effect, and counts the computing time in the gate. Without
    it equal inputs give equal commands. `clock` [s] measures durations.
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
        self._given = params
        self.planner = Planner(params, vehicle, limit_time, clock)
        self.prediction = self.planner.prediction
        self.params = params = self.prediction.params  # with the limits of the car
        self.car = self.prediction.car
        self.gate = Gate(
            params.limits, self.car, params.model.step_s, params.fallback.max_state_age_s
        )
        self.latency = LatencyEstimator(params.delay)
        self.predictor = StatePredictor(self.car)
        self._command_ns = round((params.delay.command_s or 0.0) * conversions.NS_PER_S)
        self.friction = friction_estimate.make(params, self.car)
        # the state is that which was answered last
        self.perception = ObstaclePerception(params, unknown_state(NEVER_NS))
        self.reporter = TickReporter(params, self.prediction.formulation, self.prediction.evaluator)
        self.scene = Scene(None, None, None)
        self._prepared_s: float | None = None  # computing time of the last `prepare`
        self._is_resumed = False
        self._start_from(Command(NEVER_NS, 0.0, 0.0, 0.0, 0.0))

    def set_reference(self, reference: Reference) -> str:
        """Set the path; return '' or why it is rejected (the last one stays)."""
        try:
            path = reference_path.build(reference)
        except reference_path.PathError as error:
            return str(error)
        if self.scene.path is None or not reference_path.is_equal(path, self.scene.path):
            self.scene = self.scene._replace(path=path)
            self.planner.progress.reset()
        return ''

    def set_edges(self, edges: RoadEdges) -> str:
        """Set the road edges; return '' or why they are rejected (the last ones stay)."""
        try:
            self.scene = self.scene._replace(road=road_edges.build(edges))
        except road_edges.EdgeError as error:
            return str(error)
        return ''

    def set_obstacles(self, obstacles: Obstacles) -> None:
        """Set the obstacles as of their stamp."""
        self.scene = self.scene._replace(obstacles=obstacles)

    def missing(self) -> tuple[str, ...]:
        """Return the names of the inputs that were never set."""
        return tuple(name for name, value in self.scene._asdict().items() if value is None)

    def reset(self, actuators: Actuators, resumed: bool = False) -> None:
        """Restart with the set-points where the actuators are, within their limits.

        `resumed`: after a pause, which the report of the next step says.
        """
        self._is_resumed = resumed
        self._start_from(setpoints.hold_actuators(actuators, self.params.limits, NEVER_NS))
        self.planner.reset()

    def change(self, params: ControllerParams, changes: Mapping[str, float]) -> None:
        """Plan and drive by other weights and limits from the next step on.

        `params` are those of the constructor but for `changes`, by names of
        `run_time_parameters.names`, which are reported from then on. The last plan stays, as the
        guess of the next one. `check_change` tells what is refused.
        """
        self._given = params
        self.prediction.change(params)
        self.params = self.prediction.params
        self.gate.limits = self.params.limits
        self.reporter.change(self.params, changes)

    def check_change(self, params: ControllerParams) -> None:
        """Raise ParameterError for a change that would have no effect or break off the drive."""
        changed = run_time_parameters.changed_names(self._given, params)
        self.prediction.check_effect(params, changed)
        now, limits = self.active_ramp.end, params.limits
        present = {
            'limits.steer_rad': (abs(now.delta), limits.steer_rad),
            'limits.brake_n': (-now.Fx, limits.brake_n),
            'limits.drive_n': (now.Fx, limits.drive_n),
        }
        for name, (value, limit) in present.items():
            if name in changed and value > limit:
                raise ParameterError(
                    f'{run_time_parameters.SOURCE}: {name}: is {limit:g}, and the present command '
                    f'is {value:g}; allowed from there'
                )

    def step(self, inputs: TickInputs) -> TickRecord:
        """Return the command that answers a state, with everything that led to it."""
        began = self.clock()
        x = measurement_errors.measured_state(inputs.state, self.params.measurement_errors)
        step_s = self.params.model.step_s
        effective_ns = inputs.effective_ns
        if effective_ns is None:
            effective_ns = self._effective_ns(x, inputs.age_s)
        now = self.active_ramp.end
        belief = self._update_friction(x)
        # without a delay of commands the states between two effects are under the last ramp alone
        acting = self.ramps if self._command_ns else self.ramps[-1:]
        state = self.predictor.predict(x, acting, effective_ns)
        self.perception.observe(self.scene.obstacles, inputs.state, x.stamp_ns)
        scene = self._scene_at(x.stamp_ns, effective_ns)
        decision, x0, attempt = self._decide(state, now, scene, inputs.fault)
        line = None
        if decision.plan is None:
            command, line = self._drive_without_plan(decision, state, now, scene, x.stamp_ns)
        else:
            target = setpoints.target_of_plan(decision.plan, self.car, self.params.limits)
            command = setpoints.command_to(target, now, self.car, step_s, x.stamp_ns)
        age_s = inputs.age_s + (self.clock() - began if self.limit_time else 0.0)
        checked = self.gate.check(command, self.last_command, age_s)
        if checked.reason:
            self.planner.discard_plan()
            if decision.plan is not None and checked.reason not in UNTIMELY:
                decision = self.planner.brake(REJECTED, self._is_sliding(state))
                command, line = self._drive_without_plan(decision, state, now, scene, x.stamp_ns)
                checked = self.gate.check_substitute(command, self.last_command, age_s, checked)
        self._send(checked.command, now, effective_ns)
        resumed, self._is_resumed = self._is_resumed, False
        computing_s = self.clock() - began
        if not inputs.fault:  # braking takes no time and says nothing about the next solve
            self.latency.add(computing_s)
        return TickRecord(
            inputs=inputs,
            command=checked.command,
            decision=decision,
            effective_ns=effective_ns,
            state=state,
            scene=scene,
            x0=x0,
            attempt=attempt,
            braking_line=line,
            friction=belief,
            gate_reason=checked.reason,
            rejections=dict(self.gate.rejections),
            prepared_s=self._prepared_s,
            computing_s=computing_s,
            resumed=resumed,
        )

    def report(self, record: TickRecord) -> tuple[Prediction, Why]:
        """Return the planned poses and the diagnostic values of a step."""
        return self.reporter.prediction(record), self.reporter.why(record)

    def prepare(self) -> float:
        """Use the time between steps: to be called when the command of a step is sent.

        Solves new guesses, if `candidates.explore_after_command` is set, and the problem expected
        next, if `solver.prepare` is. Returns the computing time [s], 0 if nothing is prepared.
        """
        prepares = self.params.solver.prepare
        if not (prepares or self.params.candidates.explore_after_command) or self.missing():
            return 0.0
        began = self.clock()
        self.planner.explore()
        if prepares:
            next_ns = conversions.add_seconds(self.active_ramp.begin_ns, self.params.model.step_s)
            self.planner.prepare(self._scene_at(next_ns, next_ns))
        self._prepared_s = self.clock() - began
        return self._prepared_s

    def warm_up(self, x: VehicleState, steps: int) -> Iterator[TickRecord]:
        """Step from a state that stays, without effect on later steps.

        Afterwards code and data are in memory, and the computing time is known. Nothing stays, of
        steps that raise or are not asked for any more, either. The first steps of
        a controller that compares plans meet an obstacle, so that all of its solvers have worked.
        """
        memory, scene, rejections = self._memory(), self.scene, dict(self.gate.rejections)
        compares = bool(self.planner.alternatives) and not self.missing()
        try:
            for number in range(steps):
                is_emergency = compares and number < EMERGENCIES
                self.scene = warm_up_scene.with_obstacle_ahead(scene, x) if is_emergency else scene
                stamp_ns = conversions.add_seconds(x.stamp_ns, self.params.model.step_s)
                x = x._replace(stamp_ns=stamp_ns)
                yield self.step(TickInputs(x))
            self.planner.warm_up()
        finally:
            self.scene = scene
            self._restore(memory)
            self.planner.reset()
            self.gate.rejections.clear()
            self.gate.rejections.update(rejections)

    def _memory(self) -> tuple:
        """Return what steps leave behind, the planner's plans apart."""
        learnt = (self.friction.memory, self.prediction.friction) if self.friction else None
        return self.last_command, self.ramps, self._is_too_slow, self.perception.true_state, learnt

    def _restore(self, memory: tuple) -> None:
        self.last_command, self.ramps, self._is_too_slow, self.perception.true_state, learnt = (
            memory
        )
        self.perception.reset()
        if self.friction:
            self.friction.memory, believed = learnt
            self._believe(believed)

    def set_last_command(self, command: Command) -> None:
        """Continue from `command` instead of the last one returned (replay)."""
        end, lambda_b = setpoints.setpoints_of(command, self.car)
        self.last_command = command
        active = self.active_ramp._replace(end=end, lambda_b=lambda_b)
        self.ramps = (*self.ramps[:-1], active)

    @property
    def active_ramp(self) -> SetpointRamp:
        """The set-points of the last command over time."""
        return self.ramps[-1]

    def _scene_at(self, seen_ns: int, stamp_ns: int) -> Scene:
        """Return the scene as seen at an instant, with its obstacles moved to another."""
        scene = self.scene
        if scene.obstacles is not None:
            known = self.perception.known(scene.obstacles, seen_ns)
            scene = scene._replace(obstacles=known)
        return stage_parameters.scene_at(scene, stamp_ns)

    def _start_from(self, command: Command) -> None:
        self.last_command = command
        self.ramps = (constant_ramp(*setpoints.setpoints_of(command, self.car)),)
        self._is_too_slow = False
        self.perception.reset()
        if self.friction:
            self.friction.reset()

    def _update_friction(self, x) -> FrictionBelief | None:
        """Estimate the friction, if that is on, and plan and brake with it from now on."""
        if self.friction is None:
            return None
        belief = self.friction.update(x, self.ramps)
        self._believe(belief.friction)
        return belief

    def _believe(self, friction: float) -> None:
        self.prediction.believe(friction)
        self.car = self.predictor.car = self.prediction.car

    def _send(self, command, now, effective_ns):
        due_ns = conversions.add_seconds(command.stamp_ns, self.params.model.step_s)
        due_ns = max(due_ns + self._command_ns, effective_ns)
        end, lambda_b = setpoints.setpoints_of(command, self.car)
        self.last_command = command
        sent = SetpointRamp(effective_ns, now, due_ns, end, lambda_b)
        self.ramps = (*still_needed(self.ramps, self._oldest_ns(command.stamp_ns)), sent)

    def _oldest_ns(self, stamp_ns: int) -> int:
        """Return the first instant whose set-points a later step may ask for.

        The next step predicts from a later state than that of `stamp_ns`; the estimate of the
        friction compares the two, under the set-points that acted `actuator_delay_s` before.
        """
        acted_s = self.params.friction_estimate.actuator_delay_s if self.friction else 0.0
        return conversions.add_seconds(stamp_ns, -acted_s)

    def _effective_ns(self, x, age_s) -> int:
        """Return when the command that answers `x` will take effect."""
        if not self.limit_time:
            return x.stamp_ns + self._command_ns
        received_ns = x.stamp_ns + self._command_ns
        earliest = conversions.add_seconds(received_ns, self.latency.estimate(age_s))
        latest = conversions.add_seconds(received_ns, self.params.delay.longest_s)
        # a state may be a little early: the actuators reach the last set-point first
        return min(max(earliest, self.active_ramp.end_ns), latest)

    def _decide(self, x, now, scene, fault):
        """Return (decision, stage 0 or None, attempt or None)."""
        reason = self._obstruction(x, fault)
        if reason == NOT_FINITE:
            return self.planner.continue_plan(reason), None, None
        if reason == STATE_STALE or self.missing():
            sliding = reason != STATE_STALE and self._is_sliding(x)
            return self.planner.brake(reason, sliding), None, None
        x0 = self.planner.initial_state(x, now, scene)
        if not reason and x0.theta > scene.path.length:
            reason = 'path_ended'
        if reason:
            return self.planner.brake(reason, self._is_sliding(x)), x0, None
        decision, attempt = self.planner.plan(x0, scene, self._is_sliding(x))
        return decision, x0, attempt

    def _obstruction(self, x, fault) -> str:
        """Return why no plan can be computed, or ''."""
        if fault == STATE_STALE:
            return fault
        if not np.all(np.isfinite(x)):
            return NOT_FINITE
        limits = self.params.limits
        margin = limits.speed_hysteresis_mps if self._is_too_slow else 0.0
        self._is_too_slow = x.vx < minimum_speed.least_driven(limits) + margin
        if self.missing():
            return f'no_{self.missing()[0]}'
        return fault or (TOO_SLOW if self._is_too_slow else '')

    def _is_sliding(self, x) -> bool:
        """Return whether the car slides and is to be recovered."""
        return bool(self.params.fallback.recovery) and recovery.is_sliding(x, self.car)

    def _drive_without_plan(self, decision, x, now, scene, stamp_ns) -> tuple[Command, str]:
        lookahead = self._lookahead_point(x, scene)
        recovers = decision.level == RECOVERY
        law = recovery.recovery_target if recovers else braking.braking_target
        car = self.car if recovers else self.prediction.car_to_brake
        target = law(x, now, lookahead.point, car, self.params)
        step_s = self.params.model.step_s
        command = setpoints.command_to(target, now, self.car, step_s, stamp_ns)
        return command, lookahead.line

    def _lookahead_point(self, x, scene) -> LookaheadPoint:
        theta = None
        if scene.path is not None and np.all(np.isfinite(x)):
            theta = self.planner.progress.project(x, scene)
        plan = self.planner.guiding_plan
        return braking.lookahead_point(x, plan, scene.path, theta, self.params.braking)
