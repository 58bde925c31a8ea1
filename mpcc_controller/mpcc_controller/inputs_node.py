"""What a controller node hears: taken, checked, handed to the controller, or turned down."""

import time
from collections.abc import Callable

import numpy as np
from rclpy.node import Node

from mpcc_controller import least_speed
from mpcc_controller.driving.controller import Controller, unknown_state
from mpcc_controller.driving.trigger import Lockstep, Realtime
from mpcc_controller.driving.watchdog import EDGES, OBSTACLES, REFERENCE, STATE, Asleep, Awake
from msgs_yaml import decode, raw_scenario
from msgs_yaml.types import Actuators, Obstacles, VehicleState
from node_runtime import ros, subscriptions_node
from node_runtime.clocks import SteadyClock
from node_runtime.log_filters import ChangeFilter, RejectionLog
from node_runtime.subscriptions_node import LatestMessage, PublisherMonitor

ACTUATORS = '/vehicle/actuators'
TOPICS = {
    REFERENCE: '/scenario/reference',
    EDGES: '/scenario/road_edges',
    OBSTACLES: '/scenario/obstacles',
    STATE: '/vehicle/odometry',
}
# kinds of messages that are not used: by form or range, by stamp, by what they mean
UNREADABLE, UNTIMELY, UNUSABLE = 'unreadable', 'untimely', 'unusable'


class Inputs:
    """The subscriptions of a controller node. State and actuators are kept raw until needed."""

    def __init__(
        self,
        node: Node,
        controller: Controller,
        trigger: Lockstep | Realtime,
        watchdog: Asleep | Awake,
        wall: SteadyClock,
        on_news: Callable[[], None],
    ):
        """`on_news` is called after each message that may complete what an answer needs."""
        self._node, self._controller, self._trigger = node, controller, trigger
        self._watchdog, self._wall, self._on_news = watchdog, wall, on_news
        self.state = self.actuators = self._path = None
        self.heard_ns = 0  # when the state was
        self.ignored = range(0)  # ns, stamps of states that nobody is to answer
        callbacks = {
            REFERENCE: self.on_reference,
            EDGES: self.on_edges,
            OBSTACLES: self.on_obstacles,
            STATE: self.on_odometry,
        }
        subscriptions = {
            TOPICS[name]: ros.subscribe(node, TOPICS[name], callback, raw=True)
            for name, callback in callbacks.items()
        }
        self.actuators_inbox = LatestMessage(node, ACTUATORS)
        self._state_sub = subscriptions[TOPICS[STATE]]
        self.publishers = PublisherMonitor(node, subscriptions)
        self._slow_path = ChangeFilter()
        self._refusals = {topic: RejectionLog(topic) for topic in (*TOPICS.values(), ACTUATORS)}

    def on_reference(self, raw: bytes) -> None:
        """Take the path; one that is only repeated is not built again."""
        if raw_scenario.is_repeat(raw, self._path):
            fault = self._watchdog.offer(REFERENCE, decode.stamp_ns_of(raw), self._wall.now_ns())
            if fault:
                self._turn_down(TOPICS[REFERENCE], UNTIMELY, fault)
            self._on_news()
        elif self._take(
            REFERENCE, subscriptions_node.read_reference, raw, self._controller.set_reference
        ):
            self._path = raw
            self._warn_of_slow_path()

    def on_edges(self, raw: bytes) -> None:
        """Take the road edges."""
        self._take(EDGES, subscriptions_node.read_road_edges, raw, self._controller.set_edges)

    def on_obstacles(self, raw: bytes) -> None:
        """Take the obstacles; in lockstep they complete a state."""
        self._take(OBSTACLES, subscriptions_node.read_obstacles, raw, self._set_obstacles)

    def on_odometry(self, raw: bytes) -> None:
        """Keep the state if it is one to answer."""
        kind = UNTIMELY
        try:
            stamp_ns = decode.stamp_ns_of(raw)
            if stamp_ns in self.ignored:
                return
            fault = self._watchdog.offer(STATE, stamp_ns, self._wall.now_ns())
        except decode.DecodeError as error:
            kind, fault = UNREADABLE, self._watchdog.refuse(STATE, str(error))
        if fault:
            self._turn_down(TOPICS[STATE], kind, fault)
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
            return decode.odometry(ros.deserialize(TOPICS[STATE], self.state))
        except decode.DecodeError as error:
            fault = self._watchdog.refuse(STATE, str(error))
            self._turn_down(TOPICS[STATE], UNREADABLE, fault)
            return unknown_state(decode.stamp_ns_of(self.state))

    def decoded_actuators(self) -> Actuators | None:
        """Return where the actuators are; None, logged, when their message breaks the contract."""
        try:
            return decode.actuators(ros.deserialize(ACTUATORS, self.actuators))
        except decode.DecodeError as error:
            self._turn_down(ACTUATORS, UNREADABLE, f'{error}; waiting for valid ones to start from')
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

    def _warn_of_slow_path(self):
        """Warn of desired speeds at which the controller does not drive; once per change."""
        least = self._controller.params.limits.least_speed_mps
        slowest = float(np.min(self._controller.scene.path.v))
        relation = least_speed.relation(slowest, least, least_speed.DESIRED_MARGIN_MPS)
        told = relation and (
            f'{TOPICS[REFERENCE]} asks for {slowest:.2f} m/s, {relation} '
            f'limits.least_speed_mps, {least:g} m/s: below that the car brakes to a stop'
        )
        if self._slow_path.has_changed(told) and told:
            self._node.get_logger().warning(told)

    def _take(self, name, decoder, raw, setter) -> bool:
        """Tell the controller; log what is wrong with a message, and go on with the one before."""
        kind = UNTIMELY
        try:
            value = decoder(raw)
            fault = self._watchdog.offer(name, value.stamp_ns, self._wall.now_ns())
            if not fault:
                kind, fault = UNUSABLE, setter(value)
        except decode.DecodeError as error:
            kind, fault = UNREADABLE, self._watchdog.refuse(name, str(error))
        if fault:
            self._turn_down(TOPICS[name], kind, fault)
        self._on_news()
        return not fault

    def _turn_down(self, topic, kind, fault):
        """Log why a message is not used: the first of each kind, then counts."""
        line = self._refusals[topic].line(kind, fault, time.monotonic_ns())
        if line:
            self._node.get_logger().warning(line)
