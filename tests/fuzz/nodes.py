"""Each real node alone, made in this process, with somebody who listens to what it says."""

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
LINE = np.array([[0.0, 3.5], [900.0, 3.5]])
X = np.linspace(0.0, 900.0, 10)


class Inbox:
    """What a controller takes its actuators from, filled without the middleware."""

    topic_name, raw = '/vehicle/actuators', True

    def __init__(self, node: ControllerNode):
        node.inputs.destroy()
        self.newest, self.look = None, node.advance

    def callback(self, raw: bytes) -> None:
        """Put a message in place of the one before."""
        self.newest = raw
        self.look()

    def take(self) -> bytes | None:
        """Return what came since the last call."""
        raw, self.newest = self.newest, None
        return raw

    def destroy(self) -> None:
        """Nothing is held."""


@dataclass
class Bench:
    """A node and what is around it."""

    name: str
    mode: str
    node: Node
    listener: Node
    inlets: list

    def renew(self) -> None:
        """Put a new node of the same kind in place of this one."""
        self.node.destroy_node()
        self.node = NODES[self.name]()

    def ears(self) -> list:
        """Return the subscriptions of the node to topics of the contract."""
        return ears(self.node)

    def drain(self) -> list[Any]:
        """Return what the node has said since the last call."""
        said = []
        for inlet in self.inlets:
            with inlet.handle:
                while taken := inlet.handle.take_message(inlet.msg_type, False):
                    said.append((inlet.topic_name, taken[0]))
        return said


@contextmanager
def running(name: str, mode: str) -> Iterator[Bench]:
    """Make a node in a ROS domain of its own, and destroy it in the end."""
    with domain.reserved({}) as number:
        rclpy.init(args=['--ros-args', '-p', f'mode:={mode}'], domain_id=number)
        try:
            yield from _made(name, mode)
        finally:
            rclpy.shutdown()


def _made(name, mode):
    listener = rclpy.create_node('listener', start_parameter_services=False)
    listener.declare_parameter(node_parameters.MODE, mode)
    said = {'controller': '/controller/command', 'scenario': '/scenario/obstacles'}
    inlets = [ros.subscribe(listener, said[name], print)] if name in said else []
    bench = Bench(name, mode, NODES[name](), listener, inlets)
    if name == 'controller':
        bench.node.inputs.newest_actuators = Inbox(bench.node)
    yield bench
    bench.node.destroy_node()
    listener.destroy_node()


def ears(node: Node) -> list:
    """Return by what a node hears the topics of the contract."""
    topics = contract.load().topics
    heard = [one for one in node.subscriptions if one.topic_name in topics]
    inputs = getattr(node, 'inputs', None)
    return heard if inputs is None else [*heard, inputs.newest_actuators]


def sound(stamp_ns: int) -> dict[str, Any]:
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


def tell_path(node: Node, stamp_ns: int) -> None:
    """Tell a node a valid path."""
    tell(node, '/scenario/reference', sound(stamp_ns)['/scenario/reference'])


def hearing(node: Node, topic: str) -> Any:
    """Return by what a node hears a topic."""
    (heard,) = (one for one in ears(node) if one.topic_name == topic)
    return heard


def tell(node: Node, topic: str, message: Any) -> None:
    """Call the callback of a node's subscription, with bytes where it takes bytes."""
    heard = hearing(node, topic)
    heard.callback(ros.serialize(message) if heard.raw else message)


def command(stamp_ns: int) -> Any:
    """Return a sound command."""
    return encode.command(Command(stamp_ns, 0.01, 0.0, -100.0, -50.0))
