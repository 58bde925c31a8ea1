"""A single real node in this process, with a listener for its messages."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import rclpy
from rclpy.node import Node

from experiments.run import domain
from mpcc_controller.controller_node import ControllerNode
from msgs_yaml import contract, encode
from msgs_yaml.types import (
    Actuators,
    Command,
    Obstacle,
    Obstacles,
    Reference,
    RoadEdges,
    VehicleState,
)
from node_runtime import node_parameters, ros
from scenario_publisher.scenario_node import ScenarioNode
from vehicle_plant.plant_node import PlantNode

TICK_NS = 50_000_000
NODES: dict[str, Callable[[], Node]] = {
    'controller': ControllerNode,
    'plant': PlantNode,
    'scenario': ScenarioNode,
}
OUTPUTS = {'controller': '/controller/command', 'scenario': '/scenario/obstacles'}
# no solver runs out of time, however busy this machine is
PATIENT = {'solver.time_limit_s': 10.0, 'solver.patience_s': 10.0}
LINE = np.array([[0.0, 3.5], [900.0, 3.5]])
X = np.linspace(0.0, 900.0, 10)


class Inbox:
    """The input of actuators of a controller, filled without the middleware."""

    topic_name, raw = '/vehicle/actuators', True

    def __init__(self, node: ControllerNode):
        node.inputs.destroy()
        self.newest, self.look = None, node.advance

    def callback(self, raw: bytes) -> None:
        """Replace the newest message."""
        self.newest = raw
        self.look()

    def take(self) -> bytes | None:
        """Return the message since the last call, None for none."""
        raw, self.newest = self.newest, None
        return raw

    def has_publisher(self) -> bool:
        """Return True: somebody fills it."""
        return True

    def destroy(self) -> None:
        """Do nothing: there is no subscription."""


@dataclass
class NodeBench:
    """A node under test and its listener."""

    name: str
    mode: str
    node: Node
    listener: Node
    outputs: list

    def renew(self) -> None:
        """Replace the node by a new one of the same kind."""
        self.node.destroy_node()
        self.node = _started(self.name)

    def subscriptions(self) -> list:
        """Return the subscriptions of the node to topics of the contract."""
        return subscriptions(self.node)

    def drain(self) -> list[Any]:
        """Return the messages of the node since the last call."""
        messages = []
        for output in self.outputs:
            with output.handle:
                while taken := output.handle.take_message(output.msg_type, False):
                    messages.append((output.topic_name, taken[0]))
        return messages


@contextmanager
def running(name: str, mode: str) -> Iterator[NodeBench]:
    """Create a node in a ROS domain of its own; destroy it at the end."""
    with domain.reserved({}) as number:
        given = {'mode': mode} | (PATIENT if name == 'controller' else {})
        arguments = [word for item in given.items() for word in ('-p', '{}:={}'.format(*item))]
        rclpy.init(args=['--ros-args', *arguments], domain_id=number)
        try:
            listener = rclpy.create_node('listener', start_parameter_services=False)
            listener.declare_parameter(node_parameters.MODE, mode)
            outputs = [ros.subscribe(listener, OUTPUTS[name], print)] if name in OUTPUTS else []
            bench = NodeBench(name, mode, _started(name), listener, outputs)
            if name == 'controller':
                bench.node.inputs.newest_actuators = Inbox(bench.node)
            yield bench
            bench.node.destroy_node()
            listener.destroy_node()
        finally:
            rclpy.shutdown()


def _started(name):
    node = NODES[name]()
    node.start()
    return node


def subscriptions(node: Node) -> list:
    """Return the subscriptions of a node to topics of the contract."""
    topics = contract.load().topics
    own = [one for one in node.subscriptions if one.topic_name in topics]
    inputs = getattr(node, 'inputs', None)
    return own if inputs is None else [*own, inputs.newest_actuators]


def valid_messages(stamp_ns: int) -> dict[str, Any]:
    """Return a valid message of every input of a controller by topic, the state last."""
    path = Reference(stamp_ns, X, 0 * X, 0 * X, X / 20.0)
    obstacle = Obstacle(1, 60.0, 3.0, 0.5, 0.0, 0.0)
    state = VehicleState(stamp_ns, 5.0, 0.0, 0.0, 20.0, 0.0, 0.0)
    return {
        '/scenario/reference': encode.reference(path),
        '/scenario/road_edges': encode.road_edges(RoadEdges(stamp_ns, LINE, -LINE)),
        '/vehicle/actuators': encode.actuators(Actuators(stamp_ns, 0, 0, 0, 0, (0.0,) * 4)),
        '/scenario/obstacles': encode.obstacles(Obstacles(stamp_ns, (obstacle,))),
        '/vehicle/odometry': encode.odometry(state),
    }


def send_path(node: Node, stamp_ns: int) -> None:
    """Send a node a valid path."""
    send(node, '/scenario/reference', valid_messages(stamp_ns)['/scenario/reference'])


def subscription(node: Node, topic: str) -> Any:
    """Return the subscription of a node to a topic."""
    (result,) = (one for one in subscriptions(node) if one.topic_name == topic)
    return result


def send(node: Node, topic: str, message: Any) -> None:
    """Call the callback of a node's subscription, with bytes where it takes bytes."""
    receiver = subscription(node, topic)
    receiver.callback(ros.serialize(message) if receiver.raw else message)


def command(stamp_ns: int) -> Any:
    """Return a valid command."""
    return encode.command(Command(stamp_ns, 0.01, 0.0, -100.0, -50.0))
