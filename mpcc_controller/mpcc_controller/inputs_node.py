"""What a controller node hears: taken, checked, handed to the controller, or turned down."""

import time
from collections.abc import Callable

from rclpy.node import Node

from mpcc_controller.driving.controller import Controller, unknown_state
from mpcc_controller.driving.trigger import Lockstep, Realtime
from mpcc_controller.driving.watchdog import EDGES, OBSTACLES, REFERENCE, STATE, Asleep, Awake
from msgs_yaml import contract, decode, repeats, ros
from msgs_yaml.newest_node import Newest
from msgs_yaml.types import Actuators, Obstacles, Reference, RoadEdges, VehicleState
from msgs_yaml.wall import Wall

ACTUATORS = '/vehicle/actuators'
TOPICS = {
    REFERENCE: '/scenario/reference',
    EDGES: '/scenario/road_edges',
    OBSTACLES: '/scenario/obstacles',
    STATE: '/vehicle/odometry',
}
_THROTTLE_S = 1.0
COUNT = slice(4, 8)  # of a serialised MarkerArray, behind the encapsulation: how many there are
MARKER_BYTES, POINT_BYTES = 1000, 24  # of one marker without points at most, of one point


class Inputs:
    """The subscriptions of a controller node. State and actuators are kept raw until needed."""

    def __init__(
        self,
        node: Node,
        controller: Controller,
        trigger: Lockstep | Realtime,
        watchdog: Asleep | Awake,
        wall: Wall,
        on_news: Callable[[], None],
    ):
        """`on_news` is called after each message that may complete what an answer needs."""
        self._node, self._controller, self._trigger = node, controller, trigger
        self._watchdog, self._wall, self._on_news = watchdog, wall, on_news
        self.state = self.actuators = self._path = None
        self.heard_ns = 0  # when the state was
        self.ignored = range(0)  # ns, stamps of states that nobody is to answer
        ros.subscribe(node, TOPICS[REFERENCE], self.on_reference, raw=True)
        ros.subscribe(node, TOPICS[EDGES], self.on_edges, raw=True)
        ros.subscribe(node, TOPICS[OBSTACLES], self.on_obstacles, raw=True)
        self.actuators_inbox = Newest(node, ACTUATORS)
        self._state_sub = ros.subscribe(node, TOPICS[STATE], self.on_odometry, raw=True)

    def on_reference(self, raw: bytes) -> None:
        """Take the path; one that is only repeated is not decoded, which would take too long."""
        if repeats.is_repeat(raw, self._path):
            fault = self._watchdog.offer(REFERENCE, decode.stamp_ns_of(raw), self._wall.now_ns())
            if fault:
                self._turn_down(TOPICS[REFERENCE], fault)
            self._on_news()
        elif self._take(REFERENCE, read_reference, raw, self._controller.set_reference):
            self._path = raw

    def on_edges(self, raw: bytes) -> None:
        """Take the road edges."""
        self._take(EDGES, read_edges, raw, self._controller.set_edges)

    def on_obstacles(self, raw: bytes) -> None:
        """Take the obstacles; in lockstep they complete a state."""
        self._take(OBSTACLES, read_obstacles, raw, self._set_obstacles)

    def on_odometry(self, raw: bytes) -> None:
        """Keep the state if it is one to answer."""
        try:
            stamp_ns = decode.stamp_ns_of(raw)
            if stamp_ns in self.ignored:
                return
            fault = self._watchdog.offer(STATE, stamp_ns, self._wall.now_ns())
        except decode.DecodeError as error:
            fault = self._watchdog.refuse(STATE, str(error))
        if fault:
            self._turn_down(TOPICS[STATE], fault)
        elif self._trigger.on_state(stamp_ns):
            self.state, self.heard_ns = raw, time.time_ns()
            self._on_news()

    def look_for_actuators(self) -> None:
        """Take where the actuators are, for a (re)start."""
        raw = self.actuators_inbox.take()
        if raw is None:
            return
        try:
            stamp_ns = decode.stamp_ns_of(raw)
        except decode.DecodeError:
            return  # the next one will do
        self.actuators = raw
        self._trigger.on_actuators(stamp_ns)

    def decoded_state(self) -> VehicleState:
        """Return the state; an unknown one, logged, when its message breaks the contract."""
        try:
            return decode.odometry(ros.message(TOPICS[STATE], self.state))
        except decode.DecodeError as error:
            self._turn_down(TOPICS[STATE], self._watchdog.refuse(STATE, str(error)))
            return unknown_state(decode.stamp_ns_of(self.state))

    def decoded_actuators(self) -> Actuators | None:
        """Return where the actuators are; None, logged, when their message breaks the contract."""
        try:
            return decode.actuators(ros.message(ACTUATORS, self.actuators))
        except decode.DecodeError as error:
            self._turn_down(ACTUATORS, f'{error}; waiting for valid ones to start from')
            self.actuators = None
            return None

    def missing(self) -> tuple[str, ...]:
        """Return what has never come, in words."""
        state = () if self.state else ('vehicle state',)
        actuators = () if self.actuators else ('actuators',)
        return (*self._controller.missing(), *state, *actuators)

    def has_vehicle(self) -> bool:
        """Tell whether there is a vehicle: one that has left needs no brakes."""
        return self._state_sub.get_publisher_count() > 0

    def destroy(self) -> None:
        """Leave the graph with what the node does not own."""
        self.actuators_inbox.destroy()

    def _set_obstacles(self, obstacles: Obstacles) -> str:
        self._controller.set_obstacles(obstacles)
        self._trigger.on_obstacles(obstacles.stamp_ns)
        return ''

    def _take(self, name, decoder, raw, setter) -> bool:
        """Tell the controller; log what is wrong with a message, and go on with the one before."""
        try:
            value = decoder(raw)
            fault = self._watchdog.offer(name, value.stamp_ns, self._wall.now_ns())
            if not fault:
                fault = setter(value)
        except decode.DecodeError as error:
            fault = self._watchdog.refuse(name, str(error))
        if fault:
            self._turn_down(TOPICS[name], fault)
        self._on_news()
        return not fault

    def _turn_down(self, topic, fault):
        """Say why a message is not used."""
        told = f'{topic} turned down: {fault}'
        self._node.get_logger().error(told, throttle_duration_sec=_THROTTLE_S)


def read_reference(raw: bytes) -> Reference:
    """Return the path in a serialised message.

    Raises DecodeError, also and at once when it is too long: looking at it would take seconds, in
    which no command is sent. So do the others here.
    """
    topic = TOPICS[REFERENCE]
    most = contract.load().topics[topic].sizes['poses'].high
    if len(raw) > repeats.size(most):
        told = f'{topic}: {len(raw)} bytes; allowed {repeats.size(most)}, those of {most} poses'
        raise decode.DecodeError(told)
    return decode.reference(ros.message(topic, raw))


def read_edges(raw: bytes) -> RoadEdges:
    """Return the road edges in a serialised message; DecodeError."""
    return decode.road_edges(_markers(TOPICS[EDGES], raw))


def read_obstacles(raw: bytes) -> Obstacles:
    """Return the obstacles in a serialised message; DecodeError."""
    return decode.obstacles(_markers(TOPICS[OBSTACLES], raw))


def _markers(topic, raw):
    sizes = contract.load().topics[topic].sizes
    most = sizes['markers'].high
    points = max(allowed.high for key, allowed in sizes.items() if key.endswith('.points'))
    largest = most * (MARKER_BYTES + POINT_BYTES * points)
    is_little = raw[1:2] and raw[1] & 1
    count = int.from_bytes(raw[COUNT], 'little' if is_little else 'big')
    if count > most:
        raise decode.DecodeError(f'{topic}: markers is {count} long; allowed {most} at most')
    if len(raw) > largest:
        raise decode.DecodeError(f'{topic}: {len(raw)} bytes; allowed {largest}')
    return ros.message(topic, raw)
