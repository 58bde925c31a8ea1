"""One vehicle state in, one command out, with the same stamp. No maths in this file."""

import time

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from mpcc_controller import car_file, limits_in_force
from mpcc_controller.driving import trigger, watchdog
from mpcc_controller.driving.controller import TOO_SLOW, Controller, unknown_state
from mpcc_controller.driving.explain import OK, Arrival
from mpcc_controller.driving.health import Monitor
from mpcc_controller.driving.watchdog import STATE_STALE
from mpcc_controller.inputs_node import Inputs
from mpcc_controller.parameters import ControllerParams
from msgs_yaml import conversions, decode, encode, share
from node_runtime import ros, scheduling, spin_node
from node_runtime.clocks import SteadyClock
from node_runtime.log_filters import ChangeFilter

NAME = 'controller'
LOOK_S = 0.02  # of wall time, between two looks at who is listening and at what is too old
THROTTLE_S = 1.0


class ControllerNode(Node):
    """Wires a `Controller` to its topics."""

    def __init__(self, config: str):
        """`config` names the parameter file in config/ that overrides start from."""
        super().__init__(NAME)
        params = ros.declare(
            self, ControllerParams, share.path('mpcc_controller', 'config', config)
        )
        self.params = params
        vehicle = car_file.load(params)
        self.log_cut_limits(vehicle)
        mode = ros.mode(self)
        self.get_logger().info('preparing the solver')
        self.wall = SteadyClock()
        self.controller = Controller(params, vehicle, mode == 'realtime')
        self.trigger = trigger.make(mode, params.model.step_s)
        self.watchdog = watchdog.make(mode, Monitor(NAME), params.ages)
        self.answer = None  # the messages sent last
        self.is_warm = mode == 'lockstep'  # there nobody waits for the clock
        self.waited, self.stale, self.stopping = ChangeFilter(), ChangeFilter(), ChangeFilter()

        self.command_pub = ros.publisher(self, '/controller/command')
        self.prediction_pub = ros.publisher(self, '/controller/prediction')
        self.why_pub = ros.publisher(self, '/controller/why')
        self.health_pub = ros.publisher(self, '/diagnostics')
        self.inputs = Inputs(
            self, self.controller, self.trigger, self.watchdog, self.wall, self.advance
        )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(LOOK_S, self.on_look, clock=steady)
        self.waited.has_changed(self.waiting())
        self.get_logger().info(f'ready, {mode}; {self.waiting()}')

    def log_cut_limits(self, vehicle):
        """Log the limits that are cut to what the actuators of the car can do."""
        told = limits_in_force.told(self.params, vehicle)
        if told:
            self.get_logger().info(told)

    def advance(self):
        """Answer the state if everything that the answer needs is there."""
        if self.trigger.wants_actuators:
            self.inputs.look_for_actuators()
        if self.controller.missing() or self.unheard():
            return
        due = self.trigger.due()
        if due.step and not self.is_warm:
            self.warm_up()
            return
        if due.restart and not self.restart():
            return
        if due.step:
            self.step()
        if due.repeat and self.answer:
            self.command_pub.publish(self.answer)

    def unheard(self):
        """Return who must be listening before the first command."""
        return [] if self.answer else ros.missing_subscriptions(self, {'/controller/command': 1})

    def restart(self):
        """Take the set-points from where the actuators are; return whether they were told."""
        actuators = self.inputs.decoded_actuators()
        if actuators is None:
            self.trigger.on_lost(decode.stamp_ns_of(self.inputs.state))
            return False
        self.controller.reset(actuators)
        self.get_logger().info('started from the actuators')
        return True

    def warm_up(self):
        """Answer a state for nobody, again and again; then start with the next one."""
        began_ns = self.wall.now_ns()
        x = self.inputs.decoded_state()
        for command, prediction, why in self.controller.rehearse(x, self.params.warm_up.steps):
            for made in (encode.command(command), encode.prediction(prediction), encode.why(why)):
                ros.serialize(made)
        scheduling.freeze_garbage()
        self.is_warm = True
        # what came meanwhile is old
        self.inputs.ignored = range(began_ns, self.wall.now_ns())
        self.trigger.on_lost(self.inputs.ignored.stop)
        self.get_logger().info('warm, answers the next state')

    def step(self):
        """Answer the state with a command, and say why."""
        x = self.inputs.decoded_state()
        now_ns = self.wall.now_ns()
        heard_ns = self.inputs.heard_ns
        arrival = Arrival(heard_ns, conversions.ns_to_s(time.time_ns() - heard_ns))
        fault = self.watchdog.fault(now_ns)
        self.send(self.controller.answer(x, self.trigger.age_s(now_ns), fault, arrival))

    def step_blindly(self, now_ns):
        """Brake under a stamp of this node: no state comes."""
        self.send(self.controller.answer(unknown_state(now_ns), fault=STATE_STALE))
        self.trigger.on_lost(now_ns)

    def send(self, command):
        """Publish an answer, and only then work out what there is to say about it."""
        self.answer = encode.command(command)
        self.command_pub.publish(self.answer)
        self.controller.published()
        prediction, why = self.controller.explained()
        if len(prediction.X):
            self.prediction_pub.publish(encode.prediction(prediction))
        self.why_pub.publish(encode.why(why))
        self.controller.prepare()
        self.tell(self.watchdog.on_step(why))
        told = self.told_too_slow() if why.values['reason'] == TOO_SLOW else ''
        if self.stopping.has_changed(told) and told:
            self.get_logger().warning(told)
        if why.level != OK:
            self.get_logger().warning(why.message, throttle_duration_sec=THROTTLE_S)

    def told_too_slow(self):
        """Return why the car brakes to a stop."""
        limits = self.params.limits
        return (
            f'braking to a stop: slower than limits.least_speed_mps, {limits.least_speed_mps:g} '
            f'm/s; driven on only from {limits.least_speed_mps + limits.speed_hysteresis_mps:g} m/s'
        )

    def tell(self, health):
        """Publish the health when it is to be told."""
        if health:
            self.health_pub.publish(encode.health(self.inputs.publishers.add_warnings(health)))

    def waiting(self):
        """Return what the first step waits for, '' once it was taken."""
        if self.answer:
            return ''
        missing = (*self.inputs.missing(), *self.unheard())
        return f'waiting for {", ".join(missing)}' if missing else 'waiting for its first step'

    def on_look(self):
        """Take the first step as soon as all are listening; brake when no state comes."""
        now_ns, waiting = self.wall.now_ns(), self.waiting()
        self.tell(self.watchdog.on_beat(now_ns, waiting))
        if waiting:
            if self.waited.has_changed(waiting):
                self.get_logger().info(waiting)
            self.advance()
        elif (
            self.watchdog.lost(now_ns)
            and self.trigger.is_next(now_ns)
            and self.inputs.has_vehicle()
        ):
            self.step_blindly(now_ns)
        elif self.trigger.wants_actuators:  # they may come after the state
            self.advance()
        self.say_stale(now_ns)

    def say_stale(self, now_ns):
        """Say which inputs have become too old, and when they are back; once per change."""
        fault = self.watchdog.fault(now_ns)
        if self.answer and self.stale.has_changed(fault):
            if fault:
                self.get_logger().error(f'braking: {self.watchdog.told(now_ns)}')
            else:
                self.get_logger().info('every input is back')

    def destroy_node(self):
        """Leave the graph."""
        self.inputs.destroy()
        super().destroy_node()


def run(config: str) -> int:
    """Run a controller node with a parameter file of config/ until it is stopped."""
    return spin_node.spin(lambda: ControllerNode(config))
