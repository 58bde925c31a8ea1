"""One vehicle state in, one command out, with the same stamp. No maths in this file."""

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from mpcc_controller import car_file
from mpcc_controller.driving import trigger
from mpcc_controller.driving.controller import Controller, unknown_state
from mpcc_controller.driving.explain import OK
from mpcc_controller.driving.health import Monitor
from mpcc_controller.parameters import ControllerParams
from msgs_yaml import decode, encode, ros, share, stamp

NAME = 'controller'
REMIND_S = 2.0  # of wall time, between two lines that say what is missing
LOOK_S = 0.02  # of wall time, between two looks at who is listening
THROTTLE_S = 1.0


class ControllerNode(Node):
    """Wires a `Controller` to its topics."""

    def __init__(self, config: str):
        """`config` names the parameter file in config/ that overrides start from."""
        super().__init__(NAME)
        params = ros.declare(
            self, ControllerParams, share.path('mpcc_controller', 'config', config)
        )
        mode = ros.mode(self)
        self.get_logger().info('preparing the solver')
        self.controller = Controller(params, car_file.load(params), mode == 'realtime')
        self.trigger = trigger.make(mode, params.model.step_s)
        self.monitor = Monitor(NAME)
        self.state = self.actuators = None  # raw messages, decoded when needed
        self.answer = None  # the messages sent last

        self.command_pub = ros.publisher(self, '/controller/command')
        self.prediction_pub = ros.publisher(self, '/controller/prediction')
        self.why_pub = ros.publisher(self, '/controller/why')
        self.health_pub = ros.publisher(self, '/diagnostics')
        ros.subscribe(self, '/scenario/reference', self.on_reference)
        ros.subscribe(self, '/scenario/road_edges', self.on_edges)
        ros.subscribe(self, '/scenario/obstacles', self.on_obstacles)
        ros.subscribe(self, '/vehicle/actuators', self.on_actuators, raw=True)
        ros.subscribe(self, '/vehicle/odometry', self.on_odometry, raw=True)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.reminder = self.create_timer(REMIND_S, self.on_reminder, clock=steady)
        self.looking = self.create_timer(LOOK_S, self.on_look, clock=steady)
        self.get_logger().info(f'ready, {mode}; {self.waiting()}')

    def on_reference(self, msg):
        """Take the path."""
        self.take('/scenario/reference', decode.reference, msg, self.controller.set_reference)

    def on_edges(self, msg):
        """Take the road edges."""
        self.take('/scenario/road_edges', decode.road_edges, msg, self.controller.set_edges)

    def on_obstacles(self, msg):
        """Take the obstacles; in lockstep they complete a state."""
        self.take('/scenario/obstacles', decode.obstacles, msg, self.set_obstacles)

    def set_obstacles(self, obstacles):
        """Tell controller and trigger."""
        self.controller.set_obstacles(obstacles)
        self.trigger.on_obstacles(obstacles.stamp_ns)

    def take(self, topic, decoder, msg, setter):
        """Tell the controller; log what is wrong with a message, and go on with the one before."""
        try:
            fault = setter(decoder(msg))
        except decode.DecodeError as error:
            fault = str(error)
        if fault:
            told = f'{topic} turned down: {fault}'
            self.get_logger().error(told, throttle_duration_sec=THROTTLE_S)
        self.advance()

    def on_actuators(self, raw):
        """Keep where the actuators are, for a (re)start."""
        self.actuators = raw
        self.trigger.on_actuators(decode.stamp_ns_of(raw))
        self.advance()

    def on_odometry(self, raw):
        """Keep the state if it is one to answer."""
        if self.trigger.on_state(decode.stamp_ns_of(raw)):
            self.state = raw
            self.advance()

    def advance(self):
        """Answer the state if everything that the answer needs is there."""
        if self.controller.missing() or self.unheard():
            return
        due = self.trigger.due()
        if due.restart:
            self.restart()
        if due.step:
            self.step()
        if due.repeat and self.answer:
            self.command_pub.publish(self.answer)

    def unheard(self):
        """Return who must be listening before the first command."""
        return [] if self.answer else ros.unheard(self, {'/controller/command': 1})

    def restart(self):
        """Take the set-points from where the actuators are."""
        msg = ros.message('/vehicle/actuators', self.actuators)
        self.controller.reset(decode.actuators(msg))
        self.get_logger().info('started from the actuators')

    def step(self):
        """Answer the state with a command, and say why."""
        x = self.decoded(ros.message('/vehicle/odometry', self.state))
        age_s = self.trigger.age_s(self.get_clock().now().nanoseconds)
        command, prediction, why = self.controller.step(x, age_s)
        self.answer = encode.command(command)
        self.command_pub.publish(self.answer)
        if len(prediction.X):
            self.prediction_pub.publish(encode.prediction(prediction))
        self.why_pub.publish(encode.why(why))
        self.controller.published()
        health = self.monitor.on_step(why)
        if health:
            self.health_pub.publish(encode.health(health))
        if why.level != OK:
            self.get_logger().warning(why.message, throttle_duration_sec=THROTTLE_S)

    def decoded(self, msg):
        """Return the state of a message; an unknown one, logged, when it breaks the contract."""
        try:
            return decode.odometry(msg)
        except decode.DecodeError as error:
            told = f'/vehicle/odometry turned down: {error}'
            self.get_logger().error(told, throttle_duration_sec=THROTTLE_S)
            return unknown_state(stamp.to_ns(msg.header.stamp))

    def waiting(self):
        """Return what the first step waits for."""
        state = () if self.state else ('vehicle state',)
        missing = (*self.controller.missing(), *state, *self.unheard())
        return f'waiting for {", ".join(missing)}' if missing else 'waiting for its first step'

    def on_look(self):
        """Take the first step as soon as all are listening."""
        if self.answer:
            self.looking.cancel()
        else:
            self.advance()

    def on_reminder(self):
        """Say what is missing until the first step."""
        if self.answer:
            self.reminder.cancel()
        else:
            self.get_logger().info(self.waiting())


def run(config: str) -> int:
    """Run a controller node with a parameter file of config/ until it is stopped."""
    return ros.spin(lambda: ControllerNode(config))
