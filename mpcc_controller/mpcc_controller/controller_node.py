"""One vehicle state in, one command out, with the same stamp. No maths in this file."""

import time

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from mpcc_controller import car_file
from mpcc_controller.driving import trigger, watchdog
from mpcc_controller.driving.controller import Controller, unknown_state
from mpcc_controller.driving.explain import OK, Arrival
from mpcc_controller.driving.health import Monitor
from mpcc_controller.driving.watchdog import EDGES, OBSTACLES, REFERENCE, STATE, STATE_STALE
from mpcc_controller.parameters import ControllerParams
from msgs_yaml import contract, decode, encode, realtime, repeats, ros, share, stamp
from msgs_yaml.newest_node import Newest
from msgs_yaml.wall import Spoken, Wall

NAME = 'controller'
LOOK_S = 0.02  # of wall time, between two looks at who is listening and at what is too old
THROTTLE_S = 1.0
ACTUATORS = '/vehicle/actuators'
TOPICS = {
    REFERENCE: '/scenario/reference',
    EDGES: '/scenario/road_edges',
    OBSTACLES: '/scenario/obstacles',
    STATE: '/vehicle/odometry',
}


class ControllerNode(Node):
    """Wires a `Controller` to its topics."""

    def __init__(self, config: str):
        """`config` names the parameter file in config/ that overrides start from."""
        super().__init__(NAME)
        params = ros.declare(
            self, ControllerParams, share.path('mpcc_controller', 'config', config)
        )
        self.params = params
        mode = ros.mode(self)
        self.get_logger().info('preparing the solver')
        self.wall = Wall()
        self.controller = Controller(params, car_file.load(params), mode == 'realtime')
        self.trigger = trigger.make(mode, params.model.step_s)
        self.watchdog = watchdog.make(mode, Monitor(NAME), params.ages)
        # raw messages, decoded when needed
        self.state = self.actuators = self.path = None
        self.heard_ns = 0  # when the state was
        self.answer = None  # the messages sent last
        self.is_warm = mode == 'lockstep'  # there nobody waits for the clock
        self.busy = range(0)  # ns, with warming up: what came meanwhile is old
        self.waited, self.stale = Spoken(), Spoken()

        self.command_pub = ros.publisher(self, '/controller/command')
        self.prediction_pub = ros.publisher(self, '/controller/prediction')
        self.why_pub = ros.publisher(self, '/controller/why')
        self.health_pub = ros.publisher(self, '/diagnostics')
        ros.subscribe(self, '/scenario/reference', self.on_reference, raw=True)
        ros.subscribe(self, '/scenario/road_edges', self.on_edges)
        ros.subscribe(self, '/scenario/obstacles', self.on_obstacles)
        self.actuators_inbox = Newest(self, ACTUATORS)
        self.state_sub = ros.subscribe(self, '/vehicle/odometry', self.on_odometry, raw=True)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(LOOK_S, self.on_look, clock=steady)
        self.waited.is_news(self.waiting())
        self.get_logger().info(f'ready, {mode}; {self.waiting()}')

    def on_reference(self, raw):
        """Take the path; one that is only repeated is not decoded, which would take too long."""
        if repeats.is_repeat(raw, self.path):
            fault = self.watchdog.offer(REFERENCE, decode.stamp_ns_of(raw), self.wall.now_ns())
            if fault:
                self.turn_down(TOPICS[REFERENCE], fault)
            self.advance()
        elif self.take(REFERENCE, self.read_reference, raw, self.controller.set_reference):
            self.path = raw

    def read_reference(self, raw):
        """Return the path in a serialised message; one too long would take seconds to look at."""
        topic = TOPICS[REFERENCE]
        most = contract.load().topics[topic].sizes['poses'].high
        if len(raw) > repeats.size(most):
            told = f'{topic}: {len(raw)} bytes; allowed {repeats.size(most)}, those of {most} poses'
            raise decode.DecodeError(told)
        return decode.reference(ros.message(topic, raw))

    def on_edges(self, msg):
        """Take the road edges."""
        self.take(EDGES, decode.road_edges, msg, self.controller.set_edges)

    def on_obstacles(self, msg):
        """Take the obstacles; in lockstep they complete a state."""
        self.take(OBSTACLES, decode.obstacles, msg, self.set_obstacles)

    def set_obstacles(self, obstacles):
        """Tell controller and trigger."""
        self.controller.set_obstacles(obstacles)
        self.trigger.on_obstacles(obstacles.stamp_ns)

    def take(self, name, decoder, msg, setter) -> bool:
        """Tell the controller; log what is wrong with a message, and go on with the one before."""
        try:
            value = decoder(msg)
            fault = self.watchdog.offer(name, value.stamp_ns, self.wall.now_ns())
            if not fault:
                fault = setter(value)
        except decode.DecodeError as error:
            fault = self.watchdog.refuse(name, str(error))
        if fault:
            self.turn_down(TOPICS[name], fault)
        self.advance()
        return not fault

    def turn_down(self, topic, fault):
        """Say why a message is not used."""
        told = f'{topic} turned down: {fault}'
        self.get_logger().error(told, throttle_duration_sec=THROTTLE_S)

    def look_for_actuators(self):
        """Take where the actuators are, for a (re)start."""
        raw = self.actuators_inbox.take()
        if raw is None:
            return
        try:
            stamp_ns = decode.stamp_ns_of(raw)
        except decode.DecodeError:
            return  # the next one will do
        self.actuators = raw
        self.trigger.on_actuators(stamp_ns)

    def on_odometry(self, raw):
        """Keep the state if it is one to answer."""
        try:
            stamp_ns = decode.stamp_ns_of(raw)
            if stamp_ns in self.busy:
                return
            fault = self.watchdog.offer(STATE, stamp_ns, self.wall.now_ns())
        except decode.DecodeError as error:
            fault = self.watchdog.refuse(STATE, str(error))
        if fault:
            self.turn_down(TOPICS[STATE], fault)
        elif self.trigger.on_state(stamp_ns):
            self.state, self.heard_ns = raw, time.time_ns()
            self.advance()

    def advance(self):
        """Answer the state if everything that the answer needs is there."""
        if self.trigger.wants_actuators:
            self.look_for_actuators()
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
        return [] if self.answer else ros.unheard(self, {'/controller/command': 1})

    def restart(self):
        """Take the set-points from where the actuators are; return whether they were told."""
        try:
            actuators = decode.actuators(ros.message(ACTUATORS, self.actuators))
        except decode.DecodeError as error:
            self.turn_down(ACTUATORS, f'{error}; waiting for valid ones to start from')
            self.actuators = None
            self.trigger.on_lost(decode.stamp_ns_of(self.state))
            return False
        self.controller.reset(actuators)
        self.get_logger().info('started from the actuators')
        return True

    def warm_up(self):
        """Answer a state for nobody, again and again; then start with the next one."""
        began_ns = self.wall.now_ns()
        x = self.decoded()
        for command, prediction, why in self.controller.rehearse(x, self.params.warm_up.steps):
            for made in (encode.command(command), encode.prediction(prediction), encode.why(why)):
                ros.serialized(made)
        realtime.settle()
        self.is_warm = True
        self.busy = range(began_ns, self.wall.now_ns())
        self.trigger.on_lost(self.busy.stop)
        self.get_logger().info('warm, answers the next state')

    def step(self):
        """Answer the state with a command, and say why."""
        x = self.decoded()
        now_ns = self.wall.now_ns()
        arrival = Arrival(self.heard_ns, stamp.seconds(time.time_ns() - self.heard_ns))
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
        if why.level != OK:
            self.get_logger().warning(why.message, throttle_duration_sec=THROTTLE_S)

    def tell(self, health):
        """Publish the health when it is to be told."""
        if health:
            self.health_pub.publish(encode.health(health))

    def decoded(self):
        """Return the state; an unknown one, logged, when its message breaks the contract."""
        try:
            return decode.odometry(ros.message(TOPICS[STATE], self.state))
        except decode.DecodeError as error:
            self.turn_down(TOPICS[STATE], self.watchdog.refuse(STATE, str(error)))
            return unknown_state(decode.stamp_ns_of(self.state))

    def waiting(self):
        """Return what the first step waits for, '' once it was taken."""
        if self.answer:
            return ''
        state = () if self.state else ('vehicle state',)
        actuators = () if self.actuators else ('actuators',)
        missing = (*self.controller.missing(), *state, *actuators, *self.unheard())
        return f'waiting for {", ".join(missing)}' if missing else 'waiting for its first step'

    def on_look(self):
        """Take the first step as soon as all are listening; brake when no state comes."""
        now_ns, waiting = self.wall.now_ns(), self.waiting()
        self.tell(self.watchdog.on_beat(now_ns, waiting))
        if waiting:
            if self.waited.is_news(waiting):
                self.get_logger().info(waiting)
            self.advance()
        elif self.watchdog.lost(now_ns) and self.trigger.is_next(now_ns) and self.has_vehicle():
            self.step_blindly(now_ns)
        elif self.trigger.wants_actuators:  # they may come after the state
            self.advance()
        self.say_stale(now_ns)

    def has_vehicle(self):
        """Tell whether there is a vehicle: one that has left needs no brakes."""
        return self.state_sub.get_publisher_count() > 0

    def say_stale(self, now_ns):
        """Say which inputs have become too old, and when they are back; once per change."""
        fault = self.watchdog.fault(now_ns)
        if self.answer and self.stale.is_news(fault):
            if fault:
                self.get_logger().error(f'braking: {self.watchdog.told(now_ns)}')
            else:
                self.get_logger().info('every input is back')

    def destroy_node(self):
        """Leave the graph."""
        self.actuators_inbox.destroy()
        super().destroy_node()


def run(config: str) -> int:
    """Run a controller node with a parameter file of config/ until it is stopped."""
    return ros.spin(lambda: ControllerNode(config))
