"""The real nodes, made in this process, and what each of them hears."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import rclpy

from mpcc_controller import mpcc_node
from mpcc_controller.controller_node import ControllerNode
from msgs_yaml import contract, decode, encode, ros
from msgs_yaml.types import Actuators, Obstacles, Reference, RoadEdges, VehicleState
from scenario_publisher.scenario_node import ScenarioNode
from vehicle_plant.plant_node import PlantNode


class Ear(NamedTuple):
    """One subscription of one node."""

    node: str
    topic: str
    hear: Callable[[Any], None]  # takes a message, or its bytes
    raw: bool


class Nodes:
    """Every node that hears something; the recorder takes bytes and has tests of its own."""

    def __init__(self):
        self.controller = ControllerNode(mpcc_node.CONFIG)
        self.plant = PlantNode()
        self.scenario = ScenarioNode()

    def all(self) -> dict[str, Any]:
        """Return them by name."""
        return vars(self)

    def ears(self) -> list[Ear]:
        """Return every subscription to a topic of the contract."""
        topics = contract.load().topics
        return [
            Ear(name, heard.topic, heard.callback, heard.raw)
            for name, node in self.all().items()
            for heard in node.subscriptions
            if heard.topic in topics
        ]


@contextmanager
def running(mode: str, domain: int) -> Iterator[Nodes]:
    """Make the nodes of a mode, and destroy them in the end."""
    rclpy.init(args=['--ros-args', '-p', f'mode:={mode}'], domain_id=domain)
    try:
        nodes = Nodes()
        yield nodes
        for node in nodes.all().values():
            node.destroy_node()
    finally:
        rclpy.shutdown()
