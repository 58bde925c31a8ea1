"""A second publisher is reported in the log and in the health. Real Fast DDS."""

import time

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from msgs_yaml.types import Health
from node_runtime import ros, spin_node
from node_runtime.input_monitor import ERROR, OK, WARN
from node_runtime.subscriptions_node import PublisherMonitor

PATIENCE_S = 120.0
TOPIC = '/controller/command'
WELL = Health(1, 'plant', OK, 'running', {})


class Graph:
    """A node that listens to commands in a namespace, and others that publish them."""

    def __init__(self):
        self.context = Context()
        rclpy.init(context=self.context)
        self.nodes = []
        self.listener = self.make('plant')
        subscription = ros.subscribe(self.listener, TOPIC, lambda msg: None)
        self.publishers = PublisherMonitor(self.listener, {TOPIC: subscription})
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.listener)

    def make(self, name):
        node = Node(name, context=self.context, namespace='/car1')
        node.declare_parameter('mode', 'lockstep')
        self.nodes.append(node)
        return node

    def until(self, true):
        end = time.monotonic() + PATIENCE_S
        while not true():
            assert time.monotonic() < end
            self.executor.spin_once(timeout_sec=0.05)


@pytest.fixture
def graph(domain):
    graph = Graph()
    yield graph
    spin_node.shut_down(*graph.nodes, context=graph.context)


def test_a_second_publisher_is_named_until_it_has_left(graph, capfd):
    controller, intruder = graph.make('controller'), graph.make('intruder')
    ros.publisher(controller, TOPIC)
    (subscription,) = (s for s in graph.listener.subscriptions if s.topic_name.endswith(TOPIC))
    graph.until(lambda: subscription.get_publisher_count() == 1)
    graph.publishers.update()
    assert graph.publishers.add_warnings(WELL) is WELL

    foreign = ros.publisher(intruder, TOPIC)
    graph.until(lambda: graph.publishers.add_warnings(WELL) is not WELL)
    warning = graph.publishers.add_warnings(WELL)
    assert warning.level == WARN
    expected = '2 publishers of /car1/controller/command (/car1/controller, /car1/intruder)'
    assert warning.message.startswith(expected)
    graph.publishers.update()  # no change: no second line
    assert capfd.readouterr().err.count(expected) == 1
    worse = graph.publishers.add_warnings(WELL._replace(level=ERROR, message='braking'))
    assert (worse.level, worse.message.startswith('braking; 2 publishers')) == (ERROR, True)

    intruder.destroy_publisher(foreign)
    graph.until(lambda: graph.publishers.add_warnings(WELL) is WELL)
    assert '1 publisher of /car1/controller/command again' in capfd.readouterr().err
