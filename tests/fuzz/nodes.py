"""Each real node alone, made in this process, with somebody who listens to what it says."""

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import rclpy
from rclpy.node import Node

from mpcc_controller import mpcc_node
from mpcc_controller.controller_node import ControllerNode
from msgs_yaml import contract, encode, overrides, ros
from msgs_yaml.types import (
    Actuators,
    Command,
    Obstacle,
    Obstacles,
    Reference,
    RoadEdges,
    VehicleState,
)
from scenario_publisher.scenario_node import ScenarioNode
from vehicle_plant.plant_node import PlantNode

TICK_NS = 50_000_000
NODES: dict[str, Callable[[], Node]] = {
    'controller': functools.partial(ControllerNode, mpcc_node.CONFIG),
    'plant': PlantNode,
    'scenario': ScenarioNode,
}
LINE = np.array([[0.0, 3.5], [900.0, 3.5]])
X = np.linspace(0.0, 900.0, 10)


class Inbox:
    """What a controller takes its actuators from, filled without the middleware."""

    topic, raw = '/vehicle/actuators', True

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
                    said.append((inlet.topic, taken[0]))
        return said


@contextmanager
def running(name: str, mode: str, domain: int) -> Iterator[Bench]:
    """Make a node, and destroy it in the end."""
    rclpy.init(args=['--ros-args', '-p', f'mode:={mode}'], domain_id=domain)
    try:
        listener = rclpy.create_node('listener', start_parameter_services=False)
        listener.declare_parameter(overrides.MODE, mode)
        said = {'controller': '/controller/command', 'scenario': '/scenario/obstacles'}
        inlets = [ros.subscribe(listener, said[name], print)] if name in said else []
        bench = Bench(name, mode, NODES[name](), listener, inlets)
        if name == 'controller':
            bench.node.inputs.actuators_inbox = Inbox(bench.node)
        yield bench
        bench.node.destroy_node()
        listener.destroy_node()
    finally:
        rclpy.shutdown()


def ears(node: Node) -> list:
    """Return by what a node hears the topics of the contract."""
    topics = contract.load().topics
    heard = [one for one in node.subscriptions if one.topic in topics]
    inputs = getattr(node, 'inputs', None)
    return heard if inputs is None else [*heard, inputs.actuators_inbox]


def tell_facts(node: Node, stamp_ns: int) -> None:
    """Tell a node path and edges, what of it it hears."""
    path = Reference(stamp_ns, X, 0 * X, 0 * X, X / 20.0)
    tell(node, '/scenario/reference', encode.reference(path))
    tell(node, '/scenario/road_edges', encode.road_edges(RoadEdges(stamp_ns, LINE, -LINE)))


def tell_tick(node: ControllerNode, stamp_ns: int) -> None:
    """Tell a controller everything that it needs to answer a state."""
    obstacle = Obstacle(1, 60.0, 3.0, 0.5, 0.0, 0.0)
    tell(node, '/vehicle/actuators', encode.actuators(Actuators(stamp_ns, 0, 0, 0, 0, (0.0,) * 4)))
    state = VehicleState(stamp_ns, 5.0, 0.0, 0.0, 20.0, 0.0, 0.0)
    tell(node, '/vehicle/odometry', encode.odometry(state))
    tell(node, '/scenario/obstacles', encode.obstacles(Obstacles(stamp_ns, (obstacle,))))


def tell(node: Node, topic: str, message: Any) -> None:
    """Call the callback of a node's subscription, with bytes where it takes bytes."""
    for heard in ears(node):
        if heard.topic == topic:
            heard.callback(ros.serialized(message) if heard.raw else message)


def command(stamp_ns: int) -> Any:
    """Return a sound command."""
    return encode.command(Command(stamp_ns, 0.01, 0.0, -100.0, -50.0))
