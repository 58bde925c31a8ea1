"""The subscriptions of a controller node: messages are checked, then used or rejected."""

import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial

import numpy as np
from rclpy.node import Node

from mpcc_controller import in_force
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.records import unknown_state
from mpcc_controller.driving.trigger import LockstepTrigger, RealtimeTrigger
from mpcc_controller.driving.watchdog import (
    EDGES,
    OBSTACLES,
    REFERENCE,
    STATE,
    Watchdog,
)
from msgs_yaml import decode, raw_scenario
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Actuators, Obstacles, Reference, VehicleState
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
PREDICTIONS = '/scenario/predictions'
ALONE_NS = NS_PER_S  # DDS makes publishers of one process known within milliseconds
NO_TORQUES = (0.0, 0.0, 0.0, 0.0)
# why messages are rejected: by form or range, by stamp, by content
UNREADABLE, UNTIMELY, UNUSABLE = 'unreadable', 'untimely', 'unusable'


class ControllerInputs:
    """The inputs of a controller node. State and actuators are decoded when needed only."""

    def __init__(
        self,
        node: Node,
        controller: Controller,
        trigger: LockstepTrigger | RealtimeTrigger,
        watchdog: Watchdog,
        wall: SteadyClock,
        on_input: Callable[[], None],
    ):
        """`on_input` is called after each message that may complete the inputs of a step."""
        self._node, self._controller, self._trigger = node, controller, trigger
        self._watchdog, self._wall, self._on_input = watchdog, wall, on_input
        self.state = self.actuators = None
        self._used: dict[str, bytes] = {}  # path and edges, the last that was accepted
        self.received_ns = 0  # wall time, of the state
        self.ignored_ns = range(0)  # stamps of states that are not answered
        self._alone_since_ns = None  # wall time, from when on a state came without actuators
        self._waits_since_ns = None  # wall time, from when on a later state did
        read_path, read_edges = (
            subscriptions_node.read_reference,
            subscriptions_node.read_road_edges,
        )
        callbacks = {
            REFERENCE: partial(self._use_new, REFERENCE, read_path, self._set_reference),
            EDGES: partial(self._use_new, EDGES, read_edges, controller.set_edges),
            # in lockstep they complete the inputs of a step
            OBSTACLES: partial(self._use, OBSTACLES, self._read_obstacles, self._set_obstacles),
            STATE: self.on_odometry,
        }
        topics = {TOPICS[name]: callback for name, callback in callbacks.items()}
        topics[PREDICTIONS] = self.on_predictions
        subscriptions = {
            topic: ros.subscribe(node, topic, self._noting(callback), raw=True)
            for topic, callback in topics.items()
        }
        self._predictions_sub = subscriptions[PREDICTIONS]
        self.newest_actuators = LatestMessage(node, ACTUATORS)
        self._state_sub = subscriptions[TOPICS[STATE]]
        self.publishers = PublisherMonitor(node, subscriptions)
        self._slow_path = ChangeFilter()
        logged = (*topics, ACTUATORS, f'object of {TOPICS[OBSTACLES]}', f'object of {PREDICTIONS}')
        self._refusals = {topic: RejectionLog(topic) for topic in logged}

    def on_odometry(self, raw: bytes) -> None:
        """Keep the state if it is to be answered."""
        kind = UNTIMELY
        try:
            stamp_ns = decode.stamp_ns_of(raw)
            if stamp_ns in self.ignored_ns:
                return
            fault = self._watchdog.offer(STATE, stamp_ns, self._wall.now_ns())
        except decode.DecodeError as error:
            kind, fault = UNREADABLE, self._watchdog.reject(STATE, str(error))
        if fault:
            self._reject(TOPICS[STATE], kind, fault)
        elif self._trigger.on_state(stamp_ns):
            self.state, self.received_ns = raw, time.time_ns()
            self._on_input()

    def on_predictions(self, raw: bytes) -> None:
        """Keep what others predict of the obstacles; a rejected message leaves the last one."""
        try:
            # in lockstep a state waits for it, whatever is wrong with it
            self._trigger.predictions = decode.stamp_ns_of(raw)
            predictions = subscriptions_node.read_predictions(raw)
            for kind, reason in predictions.refused:
                self._reject(f'object of {PREDICTIONS}', kind, reason)
            self._controller.set_predictions(predictions)
        except decode.DecodeError as error:
            self._reject(PREDICTIONS, UNREADABLE, str(error))
        self._on_input()

    def take_actuators(self) -> None:
        """Take the newest message of the actuators, for a (re)start or the state of a tick.

        A first state that nobody publishes actuators for is answered after a second without them;
        as late those are not compared any more that do not come with the states.
        """
        newest, trigger, now_ns = self.newest_actuators, self._trigger, self._wall.now_ns()
        raw = newest.take()
        if raw is not None:
            # after a message that cannot be read the next one follows within a millisecond
            with suppress(decode.DecodeError):
                trigger.actuators = decode.stamp_ns_of(raw)
                self.actuators = raw
        elif not trigger.begins or newest.has_publisher():
            self._alone_since_ns = None
        else:
            self._alone_since_ns = self._alone_since_ns or now_ns
            if now_ns - self._alone_since_ns > ALONE_NS:
                trigger.actuators, self.actuators = trigger.state, None
        if not trigger.waits_for_actuators:
            self._waits_since_ns = None
            return
        self._waits_since_ns = self._waits_since_ns or now_ns
        if now_ns - self._waits_since_ns > ALONE_NS:
            trigger.with_states = False
            self._node.get_logger().warning(
                f'no message of {ACTUATORS} has the stamp of the state: not compared any more'
            )

    def decode_state(self) -> VehicleState:
        """Return the state; an unknown one, logged, if its message violates the contract."""
        try:
            return subscriptions_node.read_odometry(self.state)
        except decode.DecodeError as error:
            fault = self._watchdog.reject(STATE, str(error))
            self._reject(TOPICS[STATE], UNREADABLE, fault)
            return unknown_state(decode.stamp_ns_of(self.state))

    def measured_actuators(self) -> Actuators | None:
        """Return the newest actuators, None without any or, logged, if they are invalid."""
        self.take_actuators()
        if self.actuators is None or not self._trigger.with_states:
            return None
        return self._read_actuators('not compared with the set-points')

    def decode_actuators(self) -> Actuators | None:
        """Return the actuators; None, logged, if their message violates the contract.

        Of a car that publishes none: where the last command put them, at the start at rest.
        """
        if self.actuators is None:
            last, stamp_ns = self._controller.memory.last, decode.stamp_ns_of(self.state)
            return Actuators(stamp_ns, last.delta, 0.0, last.Fxf, last.Fxr, NO_TORQUES)
        actuators = self._read_actuators('waiting for valid ones to start from')
        if actuators is None:
            self.actuators = None
        else:
            self._trigger.with_states = True
        return actuators

    def _read_actuators(self, consequence: str) -> Actuators | None:
        """Return the actuators; None, logged with what follows, if they violate the contract."""
        try:
            return subscriptions_node.read_actuators(self.actuators)
        except decode.DecodeError as error:
            self._reject(ACTUATORS, UNREADABLE, f'{error}; {consequence}')
            return None

    def refuse_path_elsewhere(self) -> bool:
        """Drop a path that came before the first state and does not fit it; return whether."""
        fault = self._controller.drop_path_elsewhere(self.decode_state())
        if fault:
            self._used.pop(REFERENCE, None)
            self._watchdog.reject(REFERENCE, fault)
            self._reject(TOPICS[REFERENCE], UNUSABLE, fault)
        return bool(fault)

    def missing(self) -> tuple[str, ...]:
        """Return the names of the inputs that were never received."""
        state = () if self.state else ('vehicle state',)
        actuators = () if self.actuators else ('actuators',)
        return (*self._controller.missing(), *state, *actuators)

    def has_vehicle(self) -> bool:
        """Return whether a vehicle publishes its state: without one there is nothing to brake."""
        return self._state_sub.get_publisher_count() > 0

    def destroy(self) -> None:
        """Leave the graph with what the node does not own itself."""
        self.newest_actuators.destroy()

    def _noting(self, callback):
        """Return a callback whose exceptions are counted: a message must not end the drive."""

        def receive(raw):
            try:
                callback(raw)
            except Exception as error:
                self._controller.errors.add(error)

        return receive

    def _set_reference(self, reference: Reference) -> str:
        x = None
        with suppress(decode.DecodeError):
            x = subscriptions_node.read_odometry(self.state) if self.state else None
        fault = self._controller.set_reference(reference, x)
        if fault:
            return fault
        # once per change, before a step, which may warn of its consequence
        minimum = self._controller.params.limits.least_speed_mps
        slowest = float(np.min(self._controller.scene.path.v))
        relation = in_force.compare_speed(slowest, minimum, in_force.DESIRED_MARGIN_MPS)
        warning = relation and (
            f'{TOPICS[REFERENCE]} asks for {slowest:.2f} m/s, {relation} '
            f'limits.least_speed_mps, {minimum:g} m/s: below that the car brakes to a stop'
        )
        if self._slow_path.has_changed(warning) and warning:
            self._node.get_logger().warning(warning)
        return ''

    def _read_obstacles(self, raw: bytes) -> Obstacles:
        """Return the obstacles, without a stamp those of now; log and count refused objects."""
        obstacles = subscriptions_node.read_obstacles(raw)
        for kind, reason in obstacles.refused:
            self._reject(f'object of {TOPICS[OBSTACLES]}', kind, reason)
            self._watchdog.reject(OBSTACLES, reason)
        if not obstacles.stamp_ns and ros.mode(self._node) == 'lockstep':
            raise decode.DecodeError(
                f'{TOPICS[OBSTACLES]}: without markers it has no stamp; allowed in lockstep: one '
                'marker with the action DELETEALL and the stamp of the state'
            )
        return obstacles._replace(stamp_ns=obstacles.stamp_ns or self._wall.now_ns())

    def _set_obstacles(self, obstacles: Obstacles) -> str:
        self._controller.set_obstacles(obstacles)
        self._trigger.obstacles = obstacles.stamp_ns
        # DDS makes the publishers of a node known in the order in which it made them
        self._trigger.with_predictions = self._predictions_sub.get_publisher_count() > 0
        return ''

    def _use_new(self, name, decoder, setter, raw):
        """Use a message as `_use` does; a repetition is not built again."""
        stamp_ns = raw_scenario.repeated_ns(TOPICS[name], raw, self._used.get(name))
        if stamp_ns:
            fault = self._watchdog.offer(name, stamp_ns, self._wall.now_ns())
            if fault:
                self._reject(TOPICS[name], UNTIMELY, fault)
            self._on_input()
        elif self._use(name, decoder, setter, raw):
            self._used[name] = raw

    def _use(self, name, decoder, setter, raw) -> bool:
        """Set an input of the controller; a rejected message is logged, the last one stays.

        Whatever the reason is, a rejected message counts as not received: the last one ages.
        """
        kind, now_ns = UNREADABLE, self._wall.now_ns()
        try:
            value = decoder(raw)
            kind, fault = UNTIMELY, self._watchdog.check(name, value.stamp_ns, now_ns)
            if not fault:
                kind, fault = UNUSABLE, setter(value)
        except decode.DecodeError as error:
            fault = str(error)
        except Exception as error:  # a message must not end the drive
            fault = f'{type(error).__name__}: {error}'
        if fault:
            self._watchdog.reject(name, fault)
            self._reject(TOPICS[name], kind, fault)
        else:
            self._watchdog.offer(name, value.stamp_ns, now_ns)
        self._on_input()
        return not fault

    def _reject(self, topic, kind, fault):
        """Log why a message is rejected: the first of each kind, then counts."""
        line = self._refusals[topic].line(kind, fault, time.monotonic_ns())
        if line:
            self._node.get_logger().warning(line)
