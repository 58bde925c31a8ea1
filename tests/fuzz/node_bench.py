"""A single real node in this process; its topics and clock are those of a bus (`node_ring`)."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import rclpy
from closed_loops import fixed_weights
from node_ring import Bus, name_of
from rclpy.node import Node

from experiments.run import domain
from mpcc_controller.controller_node import ControllerNode
from msgs_yaml import encode
from msgs_yaml.types import (
    Actuators,
    Branch,
    Command,
    Obstacle,
    Obstacles,
    Predictions,
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
# no solver runs out of time, however busy this machine is; what is fuzzed is no weight
CONTROLLER = {'solver.time_limit_s': 10.0, 'solver.patience_s': 10.0} | fixed_weights('mpcc')
LEFT = np.array([[0.0, 3.5], [900.0, 3.5]])
RIGHT = LEFT * [1.0, -1.0]
X = np.linspace(0.0, 900.0, 10)


class NodeBench:
    """A node under test; a controller hears that a vehicle publishes its state and actuators."""

    def __init__(self, name: str, mode: str, bus: Bus):
        self.name, self.mode, self.bus = name, mode, bus
        self.vehicle = rclpy.create_node('vehicle', start_parameter_services=False)
        self.vehicle.declare_parameter(node_parameters.MODE, mode)
        for topic in ('/vehicle/odometry', '/vehicle/actuators') if name == 'controller' else ():
            ros.publisher(self.vehicle, topic)
        self.start()

    def start(self) -> None:
        """Create and start the node."""
        self.node = NODES[self.name]()
        self.node.bus = self.bus
        self.node.start()

    def renew(self) -> None:
        """Replace the node by a new one of the same kind."""
        self.bus.forget(self.name)
        self.node.destroy_node()
        self.start()


@contextmanager
def running(name: str, mode: str, **settings: Any) -> Iterator[NodeBench]:
    """Create a node in a ROS domain of its own, with parameters; destroy it at the end."""
    with domain.reserved({}) as number:
        given = {'mode': mode, **settings} | (CONTROLLER if name == 'controller' else {})
        arguments = [word for item in given.items() for word in ('-p', '{}:={}'.format(*item))]
        rclpy.init(args=['--ros-args', *arguments], domain_id=number)
        bus = Bus(0)
        try:
            with bus.connecting():
                bench = NodeBench(name, mode, bus)
                yield bench
                bench.node.destroy_node()
                bench.vehicle.destroy_node()
        finally:
            rclpy.shutdown()


def valid_messages(stamp_ns: int) -> dict[str, Any]:
    """Return a valid message of every input of a controller by topic, the state last."""
    path = Reference(stamp_ns, X, 0 * X, 0 * X, X / 20.0)
    obstacle = Obstacle(1, 60.0, 3.0, 0.5, 0.0, 0.0)
    t = np.array([0.0, 1.0, 2.0])
    branch = Branch(stamp_ns, 0.8, t, 60.0 + t, 3.0 - t, np.tile(0.1 * np.eye(2), (3, 1, 1)))
    state = VehicleState(stamp_ns, 5.0, 0.0, 0.0, 20.0, 0.0, 0.0)
    return {
        '/scenario/reference': encode.reference(path),
        '/scenario/road_edges': encode.road_edges(RoadEdges(stamp_ns, LEFT, RIGHT)),
        '/vehicle/actuators': encode.actuators(Actuators(stamp_ns, 0, 0, 0, 0, (0.0,) * 4)),
        '/scenario/predictions': encode.predictions(Predictions(stamp_ns, {1: (branch,)})),
        '/scenario/obstacles': encode.obstacles(Obstacles(stamp_ns, (obstacle,))),
        '/vehicle/odometry': encode.odometry(state),
    }


def send_path(node: Node, stamp_ns: int) -> None:
    """Send a node a valid path."""
    send(node, '/scenario/reference', valid_messages(stamp_ns)['/scenario/reference'])


def send(node: Node, topic: str, message: Any) -> None:
    """Let a node hear a message or its bytes."""
    raw = message if isinstance(message, bytes) else ros.serialize(message)
    (receiver,) = (
        one
        for one in node.bus.subscriptions
        if (one.topic_name, one.node_name) == (topic, name_of(node))
    )
    receiver.receive(raw)
    if receiver.is_polled:
        node.advance()


def command(stamp_ns: int) -> Any:
    """Return a valid command."""
    return encode.command(Command(stamp_ns, 0.01, 0.0, -100.0, -50.0))
