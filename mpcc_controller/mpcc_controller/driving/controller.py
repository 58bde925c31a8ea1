"""The receding-horizon controller: one state in, one command out. No ROS; SI units.

A failure is a value: whatever fails inside, `step` returns a command. It has passed the gate, or it
brakes after an internal error (`last_resort`).
"""

import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress

import numpy as np

from mpcc_controller import minimum_speed, run_time_parameters
from mpcc_controller.driving import (
    braking,
    friction_estimate,
    last_resort,
    measurement_errors,
    path_progress,
    recovery,
    setpoints,
    warm_up_scene,
)
from mpcc_controller.driving.actuator_monitor import ActuatorMonitor
from mpcc_controller.driving.braking import LookaheadPoint
from mpcc_controller.driving.delay_compensation import (
    LatencyEstimator,
    SetpointRamp,
    StatePredictor,
    constant_ramp,
    still_needed,
)
from mpcc_controller.driving.fallback import BRAKING, RECOVERY, Decision
from mpcc_controller.driving.friction_estimate import FrictionBelief
from mpcc_controller.driving.gate import UNTIMELY, Gate
from mpcc_controller.driving.internal_errors import INTERNAL_ERROR, InternalErrors
from mpcc_controller.driving.obstacle_perception import ObstaclePerception
from mpcc_controller.driving.planner import Planner
from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.driving.tick import TickInputs, TickRecord, unknown_state
from mpcc_controller.driving.tick_report import ERROR, TickReporter
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
MOST_RAMPS = 10  # kept after an error: those of the longest delay
NOT_FINITE = 'state_not_finite'
TOO_SLOW = 'too_slow'
STANDS_MPS = 0.3  # a slower car that is to stop is held with the brakes
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
        self._start_limits, self._params_to_brake = params.limits, params
        self.gate = Gate(
            params.limits,
            self.car,
            params.model.step_s,
            params.fallback.max_state_age_s,
            vehicle.actuators.force_rate_nps,
        )
        self.latency = LatencyEstimator(params.delay)
        self.predictor = StatePredictor(self.car)
        self._command_ns = round((params.delay.command_s or 0.0) * conversions.NS_PER_S)
        self.friction = friction_estimate.make(params, self.car)
        self.actuators = ActuatorMonitor(vehicle)
        # the state is that which was answered last
        self.perception = ObstaclePerception(params, unknown_state(NEVER_NS))
        self.reporter = TickReporter(params, self.prediction.formulation, self.prediction.evaluator)
        self.scene = Scene(None, None, None)
        self.errors = InternalErrors()
        self._prepared_s: float | None = None  # computing time of the last `prepare`
        self._is_resumed = False
        self._start_from(Command(NEVER_NS, 0.0, 0.0, 0.0, 0.0))

    def set_reference(self, reference: Reference, x: VehicleState | None = None) -> str:
        """Set the path; return '' or why it is rejected (the last one stays).

        With a state `x`, a path that is elsewhere is rejected (`path_progress.objection`).
        """
        try:
            path = reference_path.build(reference, self.params.surroundings.path_speed_mps)
        except reference_path.PathError as error:
            return str(error)
        fault = path_progress.objection(path, x) if x else ''
        if fault:
            return fault
        if self.scene.path is None or not reference_path.is_equal(path, self.scene.path):
            self.scene = self.scene._replace(path=path)
            self.planner.progress.reset()
        return ''

    def drop_path_elsewhere(self, x: VehicleState) -> str:
        """Drop a path that was set before a state was known and is elsewhere; return why, or ''."""
        path = self.scene.path
        fault = '' if path is None else path_progress.objection(path, x)
        if fault:
            self.scene = self.scene._replace(path=None)
        return fault

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
        self.actuators.reset(actuators)
        self.planner.reset()

    def change(self, params: ControllerParams, changes: Mapping[str, float]) -> None:
        """Plan and drive by other weights and limits from the next step on.

        `params` are those of the constructor but for `changes`, by names of
        `run_time_parameters.names`, which are reported from then on. The gate and braking without
        a plan keep the limits of the start, where these are wider. The last plan stays, as the
        guess of the next one. `check_change` tells what is refused.
        """
        self._given = params
        self.prediction.change(params)
        self.params = self.prediction.params
        limits = run_time_parameters.emergency_limits(self.params.limits, self._start_limits)
        self.gate.limits = limits
        self._params_to_brake = dataclasses.replace(self.params, limits=limits)
        self.reporter.change(self.params, changes)

    def check_change(self, params: ControllerParams) -> None:
        """Raise ParameterError for a change that would have no effect or break off the drive."""
        run_time_parameters.check_emergency_limits(params, self._start_limits)
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
        """Return the command that answers a state, with everything that led to it.

        An exception inside is counted in `errors`; the car brakes along the last plan.
        """
        began = self.clock()
        self._sent = self.last_command, self.ramps
        try:
            record = self._answer(inputs, began)
            if record.decision.plan is not None:
                self._guide = record.command.stamp_ns, record.decision.plan.X[:, :2]
            return record
        except Exception as error:
            self.errors.add(error)
            self.last_command, self.ramps = self._sent
            return self._brake_after_error(inputs, began)

    def brake(self, inputs: TickInputs) -> TickRecord:
        """Return a command that brakes, where a step could not begin or its command was not sent.

        For a caller that caught an exception outside of `step`; the law is that of one inside.
        """
        if self.last_command.stamp_ns == inputs.state.stamp_ns:
            self.last_command, self.ramps = self._sent
        return self._brake_after_error(inputs, self.clock())

    def _answer(self, inputs: TickInputs, began: float) -> TickRecord:
        x = measurement_errors.measured_state(inputs.state, self.params.measurement_errors)
        step_s = self.params.model.step_s
        effective_ns = inputs.effective_ns
        if effective_ns is None:
            effective_ns = self._effective_ns(x, inputs.age_s)
        now = self.active_ramp.end
        actuators = self.actuators.update(inputs.actuators, self.ramps, x.stamp_ns)
        start = self.actuators.start(now, self.params.limits)
        ramps = self.actuators.acting(self.ramps)
        belief = self._update_friction(x, ramps)
        if self.friction:
            x = self.friction.filtered(x)
        state = self._state_at(x, effective_ns, ramps)
        self.perception.observe(self.scene, inputs.state, x.stamp_ns)
        scene = self._scene_at(x.stamp_ns, effective_ns)
        decision, x0, attempt = self._decide(x, state, start, scene, inputs.fault)
        line = None
        if decision.plan is None:
            command, line = self._drive_without_plan(decision, state, start, scene, x.stamp_ns)
        else:
            target = setpoints.target_of_plan(decision.plan, self.car, self.params.limits)
            if attempt is None:  # an old plan, perhaps of several ticks ago
                target = setpoints.within_rates(target, start, self.gate.limits, step_s)
            command = self._command_to(target, start, x.stamp_ns)
        age_s = inputs.age_s + (self.clock() - began if self.limit_time else 0.0)
        checked = self.gate.check(command, self.last_command, age_s)
        if checked.reason and checked.reason not in UNTIMELY:
            self.planner.discard_plan()
            if decision.plan is not None:
                decision = self.planner.brake(REJECTED, self._is_sliding(state))
                command, line = self._drive_without_plan(decision, state, start, scene, x.stamp_ns)
                checked = self.gate.check_substitute(command, self.last_command, age_s, checked)
        self._send(checked.command, now, effective_ns)
        self._slid = self._is_sliding(state)
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
            actuators=actuators,
            gate_reason=checked.reason,
            rejections=dict(self.gate.rejections),
            prepared_s=self._prepared_s,
            computing_s=computing_s,
            resumed=resumed,
        )

    def _brake_after_error(self, inputs: TickInputs, began: float) -> TickRecord:
        """Return the record of a step that raised; calls nothing that the step calls."""
        x, params, active = inputs.state, self._params_to_brake, self.ramps[-1]
        with suppress(Exception):  # the next solve starts cold
            self.planner.brake(INTERNAL_ERROR)
        line, points = self._line_without_projection(x.stamp_ns)
        step_s, limits = params.model.step_s, params.limits
        command = last_resort.braking_command(
            x, self.last_command, points, self.car, limits, params.braking, step_s
        )
        effective_ns = inputs.effective_ns
        if effective_ns is None:
            effective_ns = x.stamp_ns + self._command_ns
        due_ns = x.stamp_ns + self._command_ns + round(step_s * conversions.NS_PER_S)
        force = command.Fxf + command.Fxr
        share = command.Fxf / force if force < 0 else active.lambda_b
        end = Setpoints(command.delta, force)
        sent = SetpointRamp(effective_ns, active.end, max(due_ns, effective_ns), end, share)
        self.last_command, self.ramps = command, (*self.ramps[-MOST_RAMPS:], sent)
        return TickRecord(
            inputs=inputs,
            command=command,
            decision=Decision(BRAKING, INTERNAL_ERROR, None),
            effective_ns=effective_ns,
            state=x,
            scene=self.scene,
            x0=None,
            attempt=None,
            braking_line=line,
            friction=None,
            actuators=None,
            gate_reason='',
            rejections=dict(self.gate.rejections),
            prepared_s=None,
            computing_s=self.clock() - began,
        )

    def _line_without_projection(self, stamp_ns: int) -> tuple[str, np.ndarray | None]:
        """Return name and points (n, 2) of the line to brake along after an error."""
        longest_s = self.params.fallback.max_guide_age * self.params.model.step_s
        if self._guide and 0 <= stamp_ns - self._guide[0] <= longest_s * conversions.NS_PER_S:
            return braking.PLAN, self._guide[1]
        if self.scene.path is None:
            return braking.NONE, None
        return braking.PATH, self.scene.path.table[:2].T

    def report(self, record: TickRecord) -> tuple[Prediction, Why]:
        """Return the planned poses and the diagnostic values of a step.

        After an exception inside, which is counted in `errors`, no poses and few values.
        """
        try:
            prediction, why = self.reporter.prediction(record), self.reporter.why(record)
        except Exception as error:
            self.errors.add(error)
            stamp_ns, decision = record.inputs.state.stamp_ns, record.decision
            prediction = Prediction(stamp_ns, *np.empty((4, 0)))
            message = f'{decision.level}: {decision.reason}; {INTERNAL_ERROR} in the report'
            values = {
                'rung': decision.level,
                'reason': decision.reason,
                'gate': record.gate_reason or 'passed',
                'gate.rejections': sum(record.rejections.values()),
            }
            why = Why(stamp_ns, ERROR, message, values)
        if self.errors.counts:
            why.values['internal_errors'] = sum(self.errors.counts.values())
            why.values[INTERNAL_ERROR] = self.errors.latest
        return prediction, why

    def prepare(self) -> float:
        """Use the time between steps: to be called when the command of a step is sent.

        Solves new guesses, if `candidates.explore_after_command` is set, and the problem expected
        next, if `solver.prepare` is. Returns the computing time [s], 0 if nothing is prepared. An
        exception inside is counted in `errors`.
        """
        prepares, began = self.params.solver.prepare, self.clock()
        try:
            if not (prepares or self.params.candidates.explore_after_command) or self.missing():
                return 0.0
            self.planner.explore()
            if prepares:
                step_s = self.params.model.step_s
                next_ns = conversions.add_seconds(self.active_ramp.begin_ns, step_s)
                self.planner.prepare(self._scene_at(next_ns, next_ns))
        except Exception as error:
            self.errors.add(error)
            self.planner.prepared = None
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
            self._guide = self._known = None
            self.gate.rejections.clear()
            self.gate.rejections.update(rejections)

    def _memory(self) -> tuple:
        """Return what steps leave behind, the planner's plans apart."""
        learnt = (self.friction.memory, self.prediction.friction) if self.friction else None
        flags = self._is_too_slow, self._slid
        return self.last_command, self.ramps, flags, self.perception.true_state, learnt

    def _restore(self, memory: tuple) -> None:
        self.last_command, self.ramps, flags, self.perception.true_state, learnt = memory
        self._is_too_slow, self._slid = flags
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
            known = self.perception.known(scene, seen_ns)
            scene = scene._replace(obstacles=known)
        return stage_parameters.scene_at(scene, stamp_ns)

    def _start_from(self, command: Command) -> None:
        self.last_command = command
        self._guide: tuple[int, np.ndarray] | None = None  # stamp and points of the last plan
        self._known: VehicleState | None = None  # the last state that was
        self.ramps = (constant_ramp(*setpoints.setpoints_of(command, self.car)),)
        self._sent = self.last_command, self.ramps  # before the last step
        self._is_too_slow = self._slid = False
        self.perception.reset()
        if self.friction:
            self.friction.reset()

    def _update_friction(self, x, ramps) -> FrictionBelief | None:
        """Estimate the friction, if that is on, and plan and brake with it from now on."""
        if self.friction is None:
            return None
        belief = self.friction.update(x, ramps)
        self._believe(belief.friction)
        return belief

    def _believe(self, friction: float) -> None:
        self.prediction.believe(friction)
        self.car = self.predictor.car = self.prediction.car
        self.gate.believed = self.prediction.car_to_brake

    def _send(self, command, now, effective_ns):
        due_ns = conversions.add_seconds(command.stamp_ns, self.params.model.step_s)
        due_ns = max(due_ns + self._command_ns, effective_ns)
        end, lambda_b = setpoints.setpoints_of(command, self.car)
        self.last_command = command
        sent = SetpointRamp(effective_ns, now, due_ns, end, lambda_b)
        self.ramps = (*still_needed(self.ramps, self._oldest_ns(command.stamp_ns)), sent)

    def _oldest_ns(self, stamp_ns: int) -> int:
        """Return the first instant whose set-points a later step may ask for.

        The next step predicts from a later state than that of `stamp_ns`, or from the last one that
        was known; the estimate of the
        friction compares the two, under the set-points that acted `actuator_delay_s` before, and
        the actuators are compared with those of a longer while.
        """
        acted_s = self.params.friction_estimate.actuator_delay_s if self.friction else 0.0
        acted_s = max(acted_s, self.actuators.memory_s)
        known_ns = stamp_ns if self._known is None else min(stamp_ns, self._known.stamp_ns)
        return conversions.add_seconds(known_ns, -acted_s)

    def _effective_ns(self, x, age_s) -> int:
        """Return when the command that answers `x` will take effect."""
        if not self.limit_time:
            return x.stamp_ns + self._command_ns
        received_ns = x.stamp_ns + self._command_ns
        earliest = conversions.add_seconds(received_ns, self.latency.estimate(age_s))
        latest = conversions.add_seconds(received_ns, self.params.delay.longest_s)
        # a state may be a little early: the actuators reach the last set-point first
        return min(max(earliest, self.active_ramp.end_ns), latest)

    def _state_at(self, x: VehicleState, effective_ns: int, ramps) -> VehicleState:
        """Return the state at which the command takes effect.

        It is predicted from `x`; where that is not known, from the last state that was, while that
        is not older than a plan may be to steer along.
        """
        # without a delay of commands the states between two effects are under the last ramp alone
        acting = ramps if self._command_ns else ramps[-1:]
        if np.all(np.isfinite(x)):
            self._known = x
        elif self._known is not None:
            age_s = conversions.ns_to_s(x.stamp_ns - self._known.stamp_ns)
            longest_s = self.params.fallback.max_guide_age * self.params.model.step_s
            if 0 <= age_s <= longest_s:
                return self.predictor.predict(self._known, ramps, effective_ns)
            self._known = None
        return self.predictor.predict(x, acting, effective_ns)

    def _decide(self, measured, x, start, scene, fault):
        """Return (decision, stage 0 or None, attempt or None) from the state `x` at the effect."""
        reason = self._obstruction(measured, x, fault)
        if reason in (NOT_FINITE, STATE_STALE):
            since_ns = measured.stamp_ns - self.last_command.stamp_ns
            step_ns = self.params.model.step_s * conversions.NS_PER_S
            return self.planner.continue_plan(reason, round(since_ns / step_ns)), None, None
        if self.missing():
            return self.planner.brake(reason, self._is_sliding(x)), None, None
        x0 = self.planner.initial_state(x, start, scene)
        if not reason and x0.theta > scene.path.length and not self._is_stopping(x, scene.path):
            reason = 'path_ended'
        if reason:
            return self.planner.brake(reason, self._is_sliding(x)), x0, None
        decision, attempt = self.planner.plan(x0, scene, self._is_sliding(x))
        return decision, x0, attempt

    def _is_stopping(self, x, path) -> bool:
        """Return whether the car is past a path that ends in a stop, and still rolls.

        The plan ends in the stop; once the car stands it is held with the brakes.
        """
        plans_stops = not self.params.limits.least_speed_mps
        return plans_stops and path.ends_in_stop and x.vx > STANDS_MPS

    def _obstruction(self, measured, x, fault) -> str:
        """Return why no plan can be computed, or ''."""
        if fault == STATE_STALE:
            return fault
        if not np.all(np.isfinite(measured)):
            return NOT_FINITE
        limits = self.params.limits
        margin = limits.speed_hysteresis_mps if self._is_too_slow else 0.0
        self._is_too_slow = x.vx < minimum_speed.least_driven(limits) + margin
        if self.missing():
            return f'no_{self.missing()[0]}'
        return fault or (TOO_SLOW if self._is_too_slow else '')

    def _is_sliding(self, x) -> bool:
        """Return whether the car slides and is to be recovered."""
        recovers = bool(self.params.fallback.recovery)
        return recovers and recovery.is_sliding(x, self.car, self._slid)

    def _command_to(self, target, start, stamp_ns) -> Command:
        """Return the command that does what was planned from the set-points `start`."""
        now, step_s = self.active_ramp.end, self.params.model.step_s
        target = self.actuators.target_from(
            target, start, now, self.car, self._params_to_brake.limits, step_s
        )
        return setpoints.command_to(target, now, self.car, step_s, stamp_ns)

    def _drive_without_plan(self, decision, x, start, scene, stamp_ns) -> tuple[Command, str]:
        lookahead = self._lookahead_point(x, scene)
        recovers = decision.level == RECOVERY
        law = recovery.recovery_target if recovers else braking.braking_target
        car = self.car if recovers else self.prediction.car_to_brake
        target = law(x, start, lookahead.point, car, self._params_to_brake)
        return self._command_to(target, start, stamp_ns), lookahead.line

    def _lookahead_point(self, x, scene) -> LookaheadPoint:
        theta = None
        if scene.path is not None and np.all(np.isfinite(x)):
            theta = self.planner.progress.project(x, scene)
        plan = self.planner.guiding_plan
        return braking.lookahead_point(x, plan, scene.path, theta, self.params.braking)
