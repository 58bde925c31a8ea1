"""The receding-horizon controller: one state in, one command out. No ROS; SI units.

A failure is a value: whatever fails inside, `step` returns a command. It has passed the gate, or it
brakes after an internal error (`last_resort`).
"""

import time
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from mpcc_controller import run_time_parameters
from mpcc_controller.driving import (
    obstacle_prediction,
    path_progress,
    planner,
    setpoints,
    stop_plan,
    tick,
)
from mpcc_controller.driving.actuator_faults import ActuatorState
from mpcc_controller.driving.delay_compensation import constant_ramp
from mpcc_controller.driving.last_resort import INTERNAL_ERROR, InternalErrors
from mpcc_controller.driving.parts import Parts
from mpcc_controller.driving.path_progress import Progress
from mpcc_controller.driving.records import Memory, TickInputs, TickRecord
from mpcc_controller.driving.tick_report import ERROR, TickReporter
from mpcc_controller.model.single_track import Car
from mpcc_controller.parameters import CarParams, ControllerParams
from mpcc_controller.path import reference_path, road_edges
from mpcc_controller.problem import cost_terms
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml import conversions
from msgs_yaml.types import (
    Actuators,
    Command,
    Obstacle,
    Obstacles,
    Prediction,
    Predictions,
    Reference,
    RoadEdges,
    StopPlan,
    VehicleState,
    Why,
)
from node_runtime import parameters
from node_runtime.parameters import ParameterError

NEVER_NS = -1  # older than every stamp
EMERGENCIES = 5  # of the steps that warm up: with an obstacle that is not there
AHEAD_S = 1.5  # of driving at the present or the desired speed, to that
LEAST_AHEAD_M = 8.0


class Controller:
    """Plans at every step and commands the first input of the plan.

    Inputs are set by `set_reference`, `set_edges`, `set_obstacles`, `set_predictions` and `reset`;
    `step` answers a state. `limit_time` (realtime) lets the solvers stop at their wall-time limits,
    plans from the state at which the command will take effect, and counts the computing time in the
    gate. Without it equal inputs give equal commands. `clock` [s] measures durations.

    Between two steps all that it has learnt is `memory`, and all that it was told `scene`.
    """

    def __init__(
        self,
        params: ControllerParams,
        vehicle: CarParams,
        limit_time: bool = False,
        clock: Callable[[], float] = time.perf_counter,
    ):
        self._given = params
        self.parts = Parts(params, vehicle, limit_time, clock)
        self.reporter = TickReporter(self.parts)
        self.scene = Scene(None, None, None)
        self.errors = InternalErrors()
        self.memory = self._begin(Command(NEVER_NS, 0.0, 0.0, 0.0, 0.0))
        self._before = self.memory  # the last step

    @property
    def params(self) -> ControllerParams:
        """The parameters in force."""
        return self.parts.params

    @property
    def car(self) -> Car:
        """The car on the road that is believed."""
        return self.parts.model.car_on(self.memory.believed)

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
        if self.scene.path is None or not np.array_equal(path.table, self.scene.path.table):
            self.scene = self.scene._replace(path=path)
            self.memory = self.memory._replace(progress=Progress())
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

    def set_predictions(self, predictions: Predictions | None) -> None:
        """Set what others predict of the obstacles, None for nothing; it ages by its stamp."""
        by_id = {} if predictions is None else predictions.by_id
        self.scene = self.scene._replace(predictions=by_id)

    def missing(self) -> tuple[str, ...]:
        """Return the names of the inputs that were never set."""
        return tick.missing(self.scene)

    def reset(self, actuators: Actuators, resumed: bool = False) -> None:
        """Restart with the set-points where the actuators are, within their limits.

        What is known of the road and of obstacles stays where the last state is not older than
        `fallback.max_guide_age`: the drive goes on. It does not after a pause (`resumed`), which
        the report of the next step says.
        """
        limits, force = self.params.limits, actuators.Fxf + actuators.Fxr
        share = np.clip(force, -limits.brake_n, limits.drive_n) / force if force else 0.0
        if actuators.Fxf * actuators.Fxr < 0:  # no axle drives while the other brakes
            share = 0.0
        held = Command(
            stamp_ns=NEVER_NS,
            delta=float(np.clip(actuators.delta, -limits.steer_rad, limits.steer_rad)),
            d_delta=0.0,
            Fxf=float(share * actuators.Fxf),
            Fxr=float(share * actuators.Fxr),
        )
        before, begun, kept = self.memory, self._begin(held), {}
        if before.known and not resumed:
            missed_s = conversions.ns_to_s(actuators.stamp_ns - before.known.stamp_ns)
            ticks = missed_s / self.params.model.step_s
            if -1 < ticks <= self.params.fallback.max_guide_age:
                # the set-points from its last state on are not known
                friction = before.friction and before.friction._replace(last=None)
                kept = {'friction': friction, 'believed': before.believed, 'tracks': before.tracks}
        self.memory = begun._replace(
            **kept,
            actuators=ActuatorState(start=actuators),
            computing_s=before.computing_s,
            rejections=before.rejections,
            resumed=resumed,
        )

    def change(self, params: ControllerParams, changes: Mapping[str, float]) -> None:
        """Plan and drive by other weights and limits from the next step on.

        `params` are those of the constructor but for `changes`, by names of
        `run_time_parameters.names`, which are reported from then on. The last plan stays, as the
        guess of the next one. `check_change` tells what is refused.
        """
        self._given = params
        self.parts.change(params)
        self.reporter.changes = dict(changes)

    def check_change(self, params: ControllerParams) -> None:
        """Raise ParameterError for a change that would have no effect or break off the drive."""
        run_time_parameters.check_emergency_limits(params, self.parts.start_limits)
        old = parameters.flatten(self._given)
        changed = [k for k, value in parameters.flatten(params).items() if value != old[k]]
        model = self.parts.model
        terms = [t for t in model.formulation.rules.terms if cost_terms.is_on(t, params)]
        known = [*(t.parameter for t in terms), *(f'envelope.{t.limit}' for t in terms if t.limit)]
        run_time_parameters.check_effect(params, changed, model.vehicle, known)
        now, limits = self.memory.ramp.end, params.limits
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
        self._before, began = self.memory, self.parts.clock()
        try:
            self.memory, record = tick.tick(self.memory, inputs, self.scene, self.parts)
        except Exception as error:
            self.errors.add(error)
            self.memory, record = tick.brake_after_error(
                self._before, inputs, self.scene, self.parts, began
            )
        return record

    def brake(self, inputs: TickInputs) -> TickRecord:
        """Return a command that brakes, where a step could not begin or its command was not sent.

        For a caller that caught an exception outside of `step`; the law is that of one inside.
        """
        if self.memory.last.stamp_ns != inputs.state.stamp_ns:  # this state is not answered yet
            self._before = self.memory
        self.memory, record = tick.brake_after_error(
            self._before, inputs, self.scene, self.parts, self.parts.clock()
        )
        return record

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

    def stop_plan(self, record: TickRecord) -> StopPlan | None:
        """Return the set-points that stop the car where no command follows that of a step.

        None for a step without a plan, and after an exception inside, which is counted in `errors`.
        """
        try:
            command_ns = self.memory.command_ns(self.parts.command_ns)
            parts = self.parts.with_faults(self.memory.actuators, self.memory.believed)
            return stop_plan.stop_plan(record, self.car, parts.params, command_ns)
        except Exception as error:
            self.errors.add(error)
            return None

    def prepare(self) -> float:
        """Use the time between steps: to be called when the command of a step is sent.

        Solves new guesses, if `candidates.explore_after_command` is set, and the problem expected
        next, if `solver.prepare` is. Returns the computing time [s], 0 if nothing is prepared. An
        exception inside is counted in `errors`.
        """
        began = self.parts.clock()
        try:
            prepares = self.params.solver.prepare
            if not (prepares or self.params.candidates.explore_after_command) or self.missing():
                return 0.0
            parts = self.parts.with_faults(self.memory.actuators, self.memory.believed)
            self.memory = planner.explore(self.memory, parts)
            if prepares:
                begin_ns = self.memory.ramp.begin_ns
                next_ns = conversions.add_seconds(begin_ns, self.params.model.step_s)
                world = obstacle_prediction.scene_at(self.memory.tracks, self.scene, next_ns)
                self.memory = planner.prepare(self.memory, world, parts)
        except Exception as error:
            self.errors.add(error)
            self.memory = self.memory._replace(prepared=None)
        prepared_s = self.parts.clock() - began
        self.memory = self.memory._replace(prepared_s=prepared_s)
        return prepared_s

    def warm_up(self, x: VehicleState, steps: int) -> Iterator[TickRecord]:
        """Step from a state that stays, without effect on later steps.

        Afterwards code and data are in memory, and the computing time is known. The first steps of
        a controller that compares plans meet an obstacle, so that all of its solvers have worked.
        """
        memory, scene, emergency = self.memory, self.scene, self.scene
        if self.parts.compares and not self.missing():  # one that a car at `x` passes or brakes for
            theta = reference_path.project(scene.path, x.X, x.Y, None, 0.0)
            _, v_ref = reference_path.arcs_at(scene.path, theta)
            ahead = max(AHEAD_S * max(x.vx, float(v_ref)), LEAST_AHEAD_M)
            arcs, _ = reference_path.arcs_at(scene.path, theta + ahead)
            obstacle = Obstacle(1, float(arcs.X), float(arcs.Y), 0.5, 0.0, 0.0)
            obstacles = scene.obstacles._replace(items=(obstacle,))
            emergency = scene._replace(obstacles=obstacles, predictions={})
        try:
            for number in range(steps):
                self.scene = emergency if number < EMERGENCIES else scene
                stamp_ns = conversions.add_seconds(x.stamp_ns, self.params.model.step_s)
                x = x._replace(stamp_ns=stamp_ns)
                yield self.step(TickInputs(x))
            if self.memory.solved is not None:
                self.parts.solvers.warm_up(self.memory.solved.problem)
        finally:
            computing_s = self.memory.computing_s
            self.scene, self.memory = scene, memory._replace(computing_s=computing_s)

    def set_last_command(self, command: Command) -> None:
        """Continue from `command` instead of the last one returned (replay)."""
        end, lambda_b = self.memory.actuators.setpoints_of(command, self.car)
        active = self.memory.ramp._replace(end=end, lambda_b=lambda_b)
        ramps = (*self.memory.ramps[:-1], active)
        self.memory = self.memory._replace(last=command, ramps=ramps)

    def _begin(self, command: Command) -> Memory:
        """Return the memory of a drive that begins after a command."""
        friction = self.parts.friction
        ramp = constant_ramp(*setpoints.setpoints_of(command, self.parts.model.car))
        return Memory(
            last=command,
            ramps=(ramp,),
            friction=friction.start if friction else None,
            believed=self.params.model.friction,
        )
