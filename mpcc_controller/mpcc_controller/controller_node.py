"""The controller node: one vehicle state in, one command out with the same stamp. No maths here.

`mpcc_node`, `frenet_node` and `controller_node` are the same node; they differ in the file of their
default parameters.
"""

import sys
import time

from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from mpcc_controller import car_file, in_force, run_time_parameters
from mpcc_controller.controller_inputs_node import ACTUATORS, ControllerInputs
from mpcc_controller.driving import trigger
from mpcc_controller.driving.actuator_faults import FAULT
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.records import TickInputs, unknown_state
from mpcc_controller.driving.tick import TOO_SLOW
from mpcc_controller.driving.tick_report import LEFT_OUT, OK
from mpcc_controller.driving.watchdog import STATE_STALE, Watchdog
from mpcc_controller.parameters import ControllerParams
from msgs_yaml import conversions, decode, encode, share
from node_runtime import parameters, ros, scheduling, spin_node
from node_runtime.clocks import SteadyClock
from node_runtime.log_filters import ChangeFilter
from node_runtime.managed_node import ManagedNode
from node_runtime.parameters import ParameterError
from stage_solver.compile_cache import CompileError

NAME = 'controller'
MPCC_CONFIG, FRENET_CONFIG = 'mpcc.yaml', 'frenet.yaml'
TIMER_S = 0.02  # of wall time, between two checks of subscribers and ages
THROTTLE_S = 1.0
LEFT = 'no vehicle publishes its state any more'


class ControllerNode(ManagedNode):
    """Connects a `Controller` to its topics."""

    def __init__(self, config: str = MPCC_CONFIG):
        """`config` names the parameter file in config/ that holds the defaults."""
        super().__init__(NAME)
        self.params = ros.declare(
            self,
            ControllerParams,
            share.path('mpcc_controller', 'config', config),
            run_time_parameters.names,
        )
        self.present = self.checked = self.params  # with what was changed since the start
        self.changes = {}  # of them, since the start
        self.vehicle = self.controller = self.inputs = None

    def configure(self):
        """Load the car, prepare the solvers and join the graph."""
        params, mode = self.params, ros.mode(self)
        self.vehicle = car_file.load(params)
        # what the car changes: limits of its actuators, and where its prediction is stable
        for text in in_force.describe_changes(params, self.vehicle):
            self.get_logger().info(text)
        self.get_logger().info('preparing the solver')
        self.wall = SteadyClock()
        try:
            self.controller = Controller(params, self.vehicle, mode == 'realtime')
        except CompileError as error:
            raise ParameterError(str(error)) from None
        if self.present != params:
            self.controller.check_change(self.present)
            self.controller.change(self.present, self.changes)
        self.trigger = trigger.make(mode, params.model.step_s)
        self.watchdog = Watchdog(NAME, params.ages if mode == 'realtime' else None)
        self.last_message = self.sent_ns = None  # the command published last, and its stamp
        self.publish_s: float | None = None  # publishing time of the last command
        self.is_warm = mode == 'lockstep'  # there simulated time waits for the first step
        self.is_new, self.is_resumed = True, False
        self.waiting_log, self.stale_log = ChangeFilter(), ChangeFilter()
        self.stopping_log, self.left_out_log = ChangeFilter(), ChangeFilter()
        self.actuators_log = ChangeFilter()

        self.command_pub = ros.publisher(self, '/controller/command')
        self.stop_plan_pub = ros.publisher(self, '/controller/stop_plan')
        self.prediction_pub = ros.publisher(self, '/controller/prediction')
        self.why_pub = ros.publisher(self, '/controller/why')
        self.health_pub = ros.publisher(self, '/diagnostics')
        self.inputs = ControllerInputs(
            self, self.controller, self.trigger, self.watchdog, self.wall, self.advance
        )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(TIMER_S, self.on_timer, clock=steady)

    def activate(self):
        """Answer states from now on; the first one from the set-points of the actuators, cold."""
        self.is_resumed = not self.is_new
        if self.is_resumed:
            self.last_message = self.sent_ns = self.publish_s = None
            self.trigger.restart()
            self.stale_log = ChangeFilter()
        self.is_new = False
        self.waiting_log = ChangeFilter()
        self.waiting_log.has_changed(self.waiting())
        self.get_logger().info(f'ready, {ros.mode(self)}; {self.waiting()}')

    def clean_up(self):
        """Drop the solvers, and the node of the newest actuators."""
        if self.inputs:
            self.inputs.destroy()
        self.controller = self.vehicle = self.inputs = None

    def check_change(self, changes):
        """Raise ParameterError for weights and limits that cannot be driven by."""
        self.checked = run_time_parameters.change(self.present, changes)
        if self.controller:
            self.controller.check_change(self.checked)

    def apply_change(self, changes):
        """Drive by the checked parameters: callbacks run between two steps, never during one."""
        before, self.present = parameters.flatten(self.present), self.checked
        self.changes = self.changes | changes
        if self.controller:
            self.controller.change(self.present, self.changes)
        for name, value in changes.items():
            self.get_logger().info(f'{name}: from {before[name]:g} to {value:g}, by request')

    def advance(self):
        """Step if every input of the step is there; brake where anything raises."""
        if not self.is_active:
            return
        stamp_ns = self.trigger.state
        try:
            due = self.begin_step()
        except Exception as error:
            self.brake(stamp_ns if self.last_message else None, error)
            if stamp_ns is not None:
                self.trigger.on_lost(stamp_ns)  # the set-points are not known
            return
        try:
            if due.step:
                self.step()
            if due.repeat and self.last_message:
                self.command_pub.publish(self.last_message)
        except Exception as error:
            self.brake(stamp_ns, error)

    def begin_step(self):
        """Return what is due once all inputs are there and the controller has its set-points."""
        if self.trigger.needs_actuators:
            self.inputs.take_actuators()
        if self.controller.missing() or self.missing_subscribers():
            return trigger.NOTHING
        due = self.trigger.due()
        if due.step and not self.is_warm:
            self.warm_up()
            return trigger.NOTHING
        return due if not due.restart or self.restart() else trigger.NOTHING

    def missing_subscribers(self):
        """Return the subscribers that must be connected before the first command."""
        if self.last_message:
            return []
        return ros.missing_subscriptions(self, {'/controller/command': 1})

    def restart(self):
        """Start from the set-points of the actuators; return whether these are known."""
        actuators = self.inputs.decode_actuators()
        if actuators is None:
            self.trigger.on_lost(decode.stamp_ns_of(self.inputs.state))
            return False
        if not self.last_message and self.inputs.refuse_path_elsewhere():
            self.trigger.on_lost(decode.stamp_ns_of(self.inputs.state))
            return False
        self.controller.reset(actuators, self.is_resumed)
        self.is_resumed = False
        if self.inputs.actuators:
            text = 'started from the actuators'  # perhaps again and again
            self.get_logger().info(text, throttle_duration_sec=THROTTLE_S)
        else:
            self.get_logger().warning(
                f'nobody publishes {ACTUATORS}: started from the last command, at first from '
                'straight wheels without any force'
            )
        return True

    def warm_up(self):
        """Step and make the messages without publishing; whatever raises, the next state is due."""
        began_ns = self.wall.now_ns()
        try:
            x = self.inputs.decode_state()
            for record in self.controller.warm_up(x, self.params.warm_up.steps):
                plan = self.controller.stop_plan(record)
                prediction, why = self.controller.report(record)
                ros.serialize(encode.command(record.command))
                if plan is not None:
                    ros.serialize(encode.stop_plan(plan))
                ros.serialize(encode.prediction(prediction))
                ros.serialize(encode.why(why))
            scheduling.freeze_garbage()
        except Exception as error:
            self.note(error)
        self.is_warm = True
        # states received meanwhile are too old
        self.inputs.ignored_ns = range(began_ns, self.wall.now_ns())
        self.trigger.on_lost(self.inputs.ignored_ns.stop)
        self.get_logger().info('warm, answers the next state')

    def step(self):
        """Answer the state with a command, then report why."""
        x, actuators = self.inputs.decode_state(), self.inputs.measured_actuators()
        now_ns, received_ns = self.wall.now_ns(), self.inputs.received_ns
        wait_s = conversions.ns_to_s(time.time_ns() - received_ns)
        fault = self.watchdog.fault(now_ns)
        age_s = self.trigger.age_s(now_ns)
        known = {'received_ns': received_ns, 'wait_s': wait_s, 'publish_s': self.publish_s}
        self.answer(TickInputs(x, age_s, fault, actuators=actuators, **known))

    def answer(self, inputs):
        """Publish the command first; explain it and prepare the next step after that."""
        record = self.controller.step(inputs)
        self.send(record.command)
        self.explain(record)

    def brake(self, stamp_ns, error):
        """Note an exception, and brake in place of an answer to the state with this stamp, if any.

        A state that was answered is not answered again. Where this raises, too, no command leaves:
        the plant brakes, as for a silent controller, and the next step starts from its actuators.
        """
        self.note(error)
        if stamp_ns in (None, self.sent_ns):
            return
        x = None
        try:
            x = self.inputs.decode_state()
        except Exception as another:
            self.note(another)
        known = x is not None and x.stamp_ns == stamp_ns
        try:
            record = self.controller.brake(TickInputs(x if known else unknown_state(stamp_ns)))
            self.send(record.command)
        except Exception as another:
            self.note(another)
            self.trigger.on_lost(stamp_ns)
        else:
            self.explain(record)

    def send(self, command):
        """Publish a command."""
        began = time.perf_counter()
        message = encode.command(command)
        self.command_pub.publish(message)
        self.last_message, self.sent_ns = message, command.stamp_ns
        self.publish_s = time.perf_counter() - began

    def note(self, error):
        """Count an exception that was caught; the first of each kind is a line of the log."""
        self.controller.errors.add(error)
        self.log_errors()

    def log_errors(self):
        """Log the kinds of exceptions that were caught for the first time."""
        for line in self.controller.errors.take_new():
            self.get_logger().error(f'internal error, counted from now on: {line}')

    def explain(self, record):
        """Publish what is to follow a command and why it was chosen, and prepare the next step.

        The car needs the next command, too, whatever raises here.
        """
        try:
            plan = self.controller.stop_plan(record)
            if plan is not None:
                self.stop_plan_pub.publish(encode.stop_plan(plan))
            prediction, why = self.controller.report(record)
            if len(prediction.X):
                self.prediction_pub.publish(encode.prediction(prediction))
            self.why_pub.publish(encode.why(why))
            self.controller.prepare()
            self.publish_health(self.watchdog.on_step(why))
            limits, is_too_slow = self.controller.params.limits, why.values['reason'] == TOO_SLOW
            stopping = in_force.stopping_text(limits) if is_too_slow else ''
            if self.stopping_log.has_changed(stopping) and stopping:
                self.get_logger().warning(stopping)
            left_out = why.values.get(LEFT_OUT, '')
            if self.left_out_log.has_changed(left_out) and left_out:
                most = self.controller.params.surroundings.max_obstacles
                text = f'left out of the obstacles, by id: {left_out}; max_obstacles is {most}'
                text += ' discs, the closest count'
                self.get_logger().warning(text)
            if self.actuators_log.has_changed(why.values.get(FAULT, '')):
                self.get_logger().warning(self.controller.memory.actuators.describe())
            if why.level != OK:
                self.get_logger().warning(why.message, throttle_duration_sec=THROTTLE_S)
        except Exception as error:
            self.note(error)
        self.log_errors()

    def publish_health(self, health):
        """Publish the health if there is one to report."""
        if health:
            self.health_pub.publish(encode.health(self.inputs.publishers.add_warnings(health)))

    def waiting(self):
        """Return what the first step waits for, '' once it was taken."""
        if self.last_message:
            return ''
        missing = (*self.inputs.missing(), *self.missing_subscribers())
        return f'waiting for {", ".join(missing)}' if missing else 'waiting for its first step'

    def on_timer(self):
        """Report the health, step without a message, log stale inputs; each despite the others."""
        if not self.is_active:
            return
        now_ns = self.wall.now_ns()
        for act in (self.check_health, self.act_without_message, self.log_stale_inputs):
            try:
                act(now_ns)
            except Exception as error:
                self.note(error)
        self.log_errors()

    def check_health(self, now_ns):
        """Check the ages of the inputs; publish the health when it is due."""
        self.publish_health(self.watchdog.on_timer(now_ns, self.waiting()))

    def act_without_message(self, now_ns):
        """Take the first step once everything is connected; brake if no state arrives."""
        waiting = self.waiting()
        if waiting:
            if self.waiting_log.has_changed(waiting):
                self.get_logger().info(waiting)
            self.advance()
        elif self.has_lost_state(now_ns):
            try:  # a stamp of this node
                x = unknown_state(now_ns)
                self.answer(TickInputs(x, fault=STATE_STALE, publish_s=self.publish_s))
            except Exception as error:
                self.brake(now_ns, error)
            self.trigger.on_lost(now_ns)
        elif self.trigger.needs_actuators:  # they may arrive after the state
            self.advance()

    def has_lost_state(self, now_ns):
        """Return whether to brake since no state arrives, also where that cannot be told."""
        try:
            return (
                self.watchdog.is_state_lost(now_ns)
                and self.trigger.is_next(now_ns)
                and self.inputs.has_vehicle()
            )
        except Exception as error:
            self.note(error)
            return ros.mode(self) == 'realtime' and self.trigger.is_next(now_ns)

    def log_stale_inputs(self, now_ns):
        """Log once per change which inputs are too old, and when they are back."""
        fault = self.watchdog.fault(now_ns)
        # with the end of a run its vehicle leaves: nothing is wrong then
        has_left = fault == STATE_STALE and not self.inputs.has_vehicle()
        if self.last_message and self.stale_log.has_changed(LEFT if has_left else fault):
            if has_left:
                self.get_logger().info(f'{LEFT}: nothing to brake')
            elif fault:
                self.get_logger().error(f'braking: {self.watchdog.describe(now_ns)}')
            else:
                self.get_logger().info('every input is back')

    def destroy_node(self):
        """Leave the graph."""
        self.clean_up()
        super().destroy_node()


def main(config: str = MPCC_CONFIG) -> None:
    """Run a controller node until it is stopped; exit with its code."""
    about = f'Answer every state of the car with a command; defaults from config/{config}.'
    example = '--ros-args -p mode:=realtime -p tolerances.lag_m:=0.3'
    sys.exit(spin_node.run(lambda: ControllerNode(config), about, example))


def mpcc_main() -> None:
    """Run the node with the defaults of the paper's MPCC."""
    main(MPCC_CONFIG)


def frenet_main() -> None:
    """Run the node with the defaults of the Frenet baseline."""
    main(FRENET_CONFIG)


if __name__ == '__main__':
    main()
