"""The real nodes of a run in this process: their topics and timers are replaced, time is simulated.

A message is delivered when the callback that sent it has returned; time goes on when none is left.
The wall clock of the nodes is that of the ring, so they drive as fast as this machine computes, and
equally often: a run on `the wall clock` is repeatable, too. DDS is not part of it.
"""

import math
import signal
from collections import deque
from collections.abc import Callable, Collection
from contextlib import ExitStack, contextmanager
from heapq import heappop, heappush
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import damage
import rclpy
import yaml
from rclpy.lifecycle.managed_entity import SimpleManagedEntity
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSCompatibility, qos_check_compatible

from bags.recorder_node import RecorderNode
from bags.storage import read
from experiments.configuration import inputs, node_config
from experiments.run import domain
from mpcc_controller.controller_node import ControllerNode
from msgs_yaml import conformance, contract, decode
from msgs_yaml.types import Command, Why
from node_runtime import ros, scheduling
from node_runtime.clocks import SteadyClock
from scenario_publisher.scenario_node import ScenarioNode
from state_estimator.estimator_node import EstimatorNode
from vehicle_plant.plant_node import PlantNode

NODES = {
    'recorder': RecorderNode,
    'controller': ControllerNode,
    'estimator': EstimatorNode,
    'plant': PlantNode,
    'scenario': ScenarioNode,  # last: nothing is latched here
}
BEGIN_NS = 1_700_000_000_000_000_000  # wall time
DELIVERY_NS = 10_000  # for a message in lockstep, where nothing else lets the wall clock go on
INBOX = '_inbox'  # ends the name of a node's second node, whose subscriptions are polled
SAMPLED_NS = 50_000_000
GRAIN_NS = 5_000_000  # timers fire not more often: the plant takes five steps at once
# the time that a solver takes is that of this machine
PATIENT = {'solver.time_limit_s': 10.0, 'solver.patience_s': 10.0}


class Timer:
    """A timer of a node, on the clock of the ring."""

    def __init__(self, bus, node, period_s, callback):
        self.bus, self.node_name, self.callback = bus, name_of(node), callback
        self.period_ns = max(round(period_s * 1e9), GRAIN_NS)
        self.reset()

    def reset(self):
        """Begin a period."""
        self.is_canceled, self.due_ns = False, self.bus.now_ns + self.period_ns

    def cancel(self):
        """Stop until `reset`."""
        self.is_canceled = True


class Publisher(SimpleManagedEntity):
    """A publisher of a node; that of a managed node publishes while it is active."""

    def __init__(self, bus, node, topic, kind, profile):
        super().__init__()
        self.bus, self.node_name, self.topic_name = bus, name_of(node), topic
        self.kind, self.profile, self.known = kind, profile, (-1, [])

    def publish(self, message):
        """Send a message, or its bytes, to every subscription that is compatible."""
        if self.is_activated:
            raw = message if isinstance(message, bytes) else ros.serialize(message)
            self.bus.send(self, raw)

    def get_subscription_count(self):
        """Return how many subscriptions receive the messages."""
        return len(self.bus.connected(self))


class Subscription:
    """A subscription: messages go to its callback, or wait for `handle.take_message`."""

    def __init__(self, bus, node, topic, kind, callback, profile, raw):
        self.bus, self.node_name, self.topic_name, self.msg_type = bus, name_of(node), topic, kind
        self.callback, self.profile, self.raw = callback, profile, raw
        is_short = profile.history == HistoryPolicy.KEEP_LAST
        self.waiting = deque(maxlen=profile.depth if is_short else None)
        self.sequence = count(1)
        self.is_polled = node.get_name().endswith(INBOX)
        self.handle = self

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass

    def receive(self, raw):
        """Take the bytes of a message; typed callbacks get only bytes that are one."""
        if self.is_polled:
            times = dict.fromkeys(('source_timestamp', 'received_timestamp'), self.bus.now_ns)
            self.waiting.append((raw, times | {'publication_sequence_number': next(self.sequence)}))
        elif self.raw:
            self.callback(raw)
        else:
            try:
                message = ros.deserialize(self.topic_name, raw)
            except decode.DecodeError:
                return  # the middleware drops it
            self.callback(message)

    def take_message(self, kind, raw):
        """Return (bytes, times) of the oldest message that waits, None for none."""
        return self.waiting.popleft() if self.waiting else None

    def get_publisher_count(self):
        """Return how many publishers this subscription can hear."""
        return sum(self in self.bus.connected(publisher) for publisher in self.bus.publishers)


class Relay(NamedTuple):
    """Changes the messages of a topic on their way to a node, '' for all, up to an instant."""

    effect: damage.Effect
    hearer: str
    is_active: Callable[[], bool]


class Bus:
    """Topics, timers and the clock of the nodes in this process."""

    def __init__(self, delivery_ns: int):
        self.now_ns, self.delivery_ns = BEGIN_NS, delivery_ns
        self.publishers, self.subscriptions, self.timers = [], [], []
        self.changes = 0  # of publishers and subscriptions
        self.pending = deque()  # (subscription, bytes) to be delivered at this instant
        self.later, self.order = [], count()  # (instant, order, subscription, bytes)
        self.relays: dict[str, Relay] = {}
        self.listeners: dict[str, list[Callable[[bytes], None]]] = {}
        self.frozen: dict[str, list] = {}  # what waits, by the name of the node

    def connected(self, publisher):
        """Return the subscriptions that a publisher reaches."""
        if publisher.known[0] != self.changes:
            reached = [
                one
                for one in self.subscriptions
                if one.topic_name == publisher.topic_name
                and qos_check_compatible(publisher.profile, one.profile)[0]
                != QoSCompatibility.ERROR
            ]
            publisher.known = self.changes, reached
        return publisher.known[1]

    def send(self, publisher, raw):
        """Deliver a message after the present callback, through the relay of its topic."""
        topic, kind = publisher.topic_name, publisher.kind
        for listener in self.listeners.get(topic, ()):
            listener(raw)
        relay, sent = self.relays.get(topic), []
        if relay:
            sent = relay.effect(raw, kind, relay.is_active())
        for subscription in self.connected(publisher):
            is_relayed = relay and relay.hearer in ('', subscription.node_name)
            for delay_s, changed in sent if is_relayed else [(0.0, raw)]:
                instant_ns = self.now_ns + round(delay_s * 1e9)
                if delay_s:
                    heappush(self.later, (instant_ns, next(self.order), subscription, changed))
                else:
                    self.pending.append((subscription, changed))

    def spin_once(self):
        """Deliver a message; without any let time go on to the next timer or delayed message."""
        timer = min(
            (t for t in self.timers if not t.is_canceled and t.node_name not in self.frozen),
            key=lambda timer: timer.due_ns,
        )
        if self.pending and self.now_ns < timer.due_ns:
            self.now_ns += self.delivery_ns
            subscription, raw = self.pending.popleft()
            if subscription in self.subscriptions:
                self.deliver(subscription, raw)
            return
        if self.later and self.later[0][0] <= timer.due_ns:
            instant_ns, _, *delivery = heappop(self.later)
            self.now_ns = max(self.now_ns, instant_ns)
            self.pending.append(delivery)
            return
        self.now_ns = max(self.now_ns, timer.due_ns)
        timer.due_ns = self.now_ns + timer.period_ns
        timer.callback()

    def deliver(self, subscription, raw):
        """Let a subscription receive bytes; a frozen node gets the newest when it goes on."""
        waiting = self.frozen.get(subscription.node_name)
        if waiting is None or subscription.is_polled:
            subscription.receive(raw)
            return
        waiting.append((subscription, raw))
        own = [delivery for delivery in waiting if delivery[0] is subscription]
        if subscription.waiting.maxlen and len(own) > subscription.waiting.maxlen:
            waiting.remove(own[0])

    def thaw(self, name):
        """Let a frozen node go on."""
        self.pending.extend(self.frozen.pop(name))

    def forget(self, name):
        """Drop what a node has here; DDS knows the publishers of a dead one for 20 s more."""
        for entities in (self.subscriptions, self.timers):
            entities[:] = [entity for entity in entities if entity.node_name != name]
        self.frozen.pop(name, None)
        self.changes += 1

    @contextmanager
    def connecting(self):
        """Make nodes use this bus for the topics of the contract, and for all timers."""
        topics, create_publisher = contract.load().topics, Node.create_publisher
        create_subscription, destroy = Node.create_subscription, Node.destroy_publisher

        def publisher(node, kind, name, profile, **more):
            topic = node.resolve_topic_name(name)
            if topic not in topics:
                return create_publisher(node, kind, name, profile, **more)
            self.publishers.append(Publisher(self, node, topic, kind, profile))
            self.changes += 1
            return self.publishers[-1]

        def subscription(node, kind, name, callback, profile, *, raw=False, **more):
            topic = node.resolve_topic_name(name)
            if topic not in topics:
                return create_subscription(node, kind, name, callback, profile, raw=raw, **more)
            new = Subscription(self, node, topic, kind, callback, profile, raw)
            self.subscriptions.append(new)
            self.changes += 1
            return new

        def timer(node, period_s, callback, *_, **__):
            self.timers.append(Timer(self, node, period_s, callback))
            return self.timers[-1]

        def destroy_publisher(node, publisher):
            if not isinstance(publisher, Publisher):
                destroy(node, publisher)
            elif publisher in self.publishers:
                self.publishers.remove(publisher)
                self.changes += 1

        def destroy_timer(node, timer):
            if timer in self.timers:
                self.timers.remove(timer)

        replaced = {
            'create_publisher': publisher,
            'create_subscription': subscription,
            'create_timer': timer,
            'destroy_publisher': destroy_publisher,
            'destroy_timer': destroy_timer,
        }

        def now_ns(clock):
            return self.now_ns

        with (
            mock.patch.multiple(Node, **replaced),
            mock.patch.object(SteadyClock, 'now_ns', now_ns),
            mock.patch.object(scheduling, 'freeze_garbage'),
        ):
            yield


class NodeRing:
    """Recorder, scenario, controller, plant and, with sensors, estimator of one run; a context."""

    def __init__(self, folder: Path, mode: str, road: str, **settings: dict[str, Any]):
        """`road` is a scenario, `settings` are {dotted name: value} of parameters, by role."""
        self.mode, self.folder, self.nodes = mode, folder, {}
        self.bus = Bus(DELIVERY_NS if mode == 'lockstep' else 0)
        settings['controller'] = PATIENT | settings.get('controller', {})
        self.configured = inputs.build_mpcc_nodes(road, mode, folder, settings)
        self.bag = folder / node_config.BAG_FOLDER
        self.late: Collection[str] = ()  # roles that a test starts
        self.speeds: list[tuple[int, float]] = []  # (stamp, m/s) of the car, every 50 ms
        self.whys: list[Why] = []
        self.commands: list[Command] = []
        self.bus.listeners = {
            '/vehicle/odometry': [self._on_odometry],
            '/controller/why': [self._on_why],
            '/controller/command': [self._on_command],
        }

    def __enter__(self):
        given = {
            node.role: {'ros__parameters': {k: _plain(v) for k, v in node.parameters.items()}}
            for node in self.configured
        }
        file = self.folder / 'parameters.yaml'
        file.write_text(yaml.safe_dump(given))
        with ExitStack() as stack:
            number = stack.enter_context(domain.reserved({}))
            for name in (signal.SIGINT, signal.SIGTERM):  # the recorder takes them
                stack.callback(signal.signal, name, signal.getsignal(name))
            rules = [f'{n.role}:{rule}' for n in self.configured for rule in n.remappings]
            given = ['--params-file', str(file), *(part for rule in rules for part in ('-r', rule))]
            rclpy.init(args=['--ros-args', *given], domain_id=number)
            stack.callback(rclpy.shutdown)
            stack.enter_context(self.bus.connecting())
            stack.callback(self._destroy)
            roles = {node.role for node in self.configured}
            for role in NODES:
                if role in roles and role not in self.late:
                    self.start(role)
            self.stack = stack.pop_all()
        return self

    def __exit__(self, *error):
        self.stack.close()

    def _destroy(self):
        if 'recorder' in self.nodes:
            self.nodes['recorder'].close()
        for role in list(self.nodes):
            self.kill(role)

    def start(self, role: str) -> None:
        """Start a node, also one that was killed."""
        self.nodes[role] = NODES[role]()
        self.nodes[role].start()

    def kill(self, role: str) -> None:
        """Take a node out, without any farewell."""
        self.bus.forget(role)
        self.nodes.pop(role).destroy_node()

    def finish(self) -> read.Bag:
        """Drive to the end of the run, whose last state is answered, too; return the bag."""
        self.spin_until(self.has_ended)
        self.spin_until(lambda: not self.bus.pending)
        return self.stop_recording()

    def stop_recording(self) -> read.Bag:
        """Complete the bag and return it; the recorder is gone then."""
        self.nodes['recorder'].close()
        self.kill('recorder')
        return read.load(self.bag)

    @property
    def stepper(self):
        """The stepper of the plant, None before the run."""
        return self.nodes['plant'].mode.stepper

    @property
    def time_ns(self) -> int:
        """The newest stamp of a state of the driving car or of a report, 0 before."""
        last_ns = self.whys[-1].stamp_ns if self.whys else 0
        return max(last_ns, self.speeds[-1][0]) if self.speeds else last_ns

    def has_ended(self) -> bool:
        """Return whether the plant has ended its run."""
        return getattr(self.nodes.get('plant'), 'finished', False)

    def is_driving(self, count: int = 20) -> bool:
        """Return whether the last reports are those of a car that follows its plans."""
        return len(self.whys) >= count and all(
            why.values['rung'] == 'solved' for why in self.whys[-count:]
        )

    def spin_until(self, condition: Callable[[], bool], most: int = 200_000) -> None:
        """Let time go on until a condition is true; AssertionError where it does not become so."""
        for _ in range(most):
            if condition():
                return
            self.bus.spin_once()
        raise AssertionError(f'the ring does not come there; last: {self.whys[-1:]}')

    def spin_for(self, seconds: float) -> None:
        """Let some time of the wall clock go by."""
        end_ns = self.bus.now_ns + round(seconds * 1e9)
        self.spin_until(lambda: self.bus.now_ns >= end_ns)

    def _on_odometry(self, raw):
        stamp_ns = decode.stamp_ns_of(raw)
        if self.stepper and stamp_ns % SAMPLED_NS == 0:
            state = decode.odometry(ros.deserialize('/vehicle/odometry', raw))
            self.speeds.append((stamp_ns, math.hypot(state.vx, state.vy)))

    def _on_why(self, raw):
        self.whys.append(decode.why(ros.deserialize('/controller/why', raw)))

    def _on_command(self, raw):
        message = ros.deserialize('/controller/command', raw)
        violations = conformance.check('/controller/command', message)
        assert not violations, violations
        self.commands.append(decode.command(message))


def name_of(node: Node) -> str:
    """Return the name of a node, also of its second one without an executor."""
    return node.get_name().removesuffix(INBOX)


def _plain(value):
    return list(value) if isinstance(value, tuple) else value
