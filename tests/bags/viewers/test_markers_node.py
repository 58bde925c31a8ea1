"""markers_node over real Fast DDS: it draws what it sees, and holds nobody up."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import rclpy

from bags.experiments import experiment
from msgs_yaml import conformance, contract, encode, parameters, ros, share
from msgs_yaml.types import Obstacle, Obstacles, Prediction, VehicleState, Why

DOMAIN = 50
CUT = bytes.fromhex('00010000ff')  # no message of any type
SECONDS = 60.0
S = 1_000_000_000
DRAWN = ('/markers/vehicle', '/markers/safety', '/markers/prediction')


@pytest.fixture
def node():
    """Return a node that plays the ring, and a markers_node that watches it."""
    process = subprocess.Popen(
        [sys.executable, '-m', 'bags.markers_node', '--ros-args', '-p', 'outline.width_m:=1.7'],
        env={**os.environ, 'ROS_DOMAIN_ID': str(DOMAIN)},
    )
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    made = rclpy.create_node('ring', context=context)
    made.declare_parameter('mode', 'lockstep')
    yield made
    made.destroy_node()
    rclpy.shutdown(context=context)
    process.send_signal(signal.SIGTERM)
    assert process.wait(SECONDS) == 0


def test_it_draws_the_ring_with_its_own_parameters(node):
    received = {}
    for topic in DRAWN:
        ros.subscribe(node, topic, lambda message, t=topic: received.setdefault(t, message))
    pubs = {
        topic: ros.publisher(node, topic)
        for topic in (
            '/vehicle/odometry',
            '/scenario/obstacles',
            '/controller/why',
            '/controller/prediction',
        )
    }
    executor = rclpy.executors.SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    end = time.monotonic() + SECONDS
    stages = np.arange(51) * 0.05
    for k in range(10_000):
        assert time.monotonic() < end, received.keys()
        t = S + 50_000_000 * k
        sent = {
            '/scenario/obstacles': encode.obstacles(
                Obstacles(t, (Obstacle(3, 60.0, 0.0, 1.0, 0.0, 0.0),))
            ),
            '/controller/why': encode.why(Why(t, 0, 'solved', {'friction.front': 0.5})),
            '/controller/prediction': encode.prediction(
                Prediction(t, 20.0 * stages, 0.0 * stages, 0.0 * stages, stages)
            ),
            '/vehicle/odometry': encode.odometry(VehicleState(t, 1.0, 2.0, 0.0, 20.0, 0.0, 0.0)),
        }
        for topic, message in sent.items():
            # queues of one message: a bad one would take the place of a good one
            pubs[topic].publish(CUT if k % 2 else message)
        executor.spin_once(timeout_sec=0.05)
        complete = len(received) == len(DRAWN)
        names = {one.ns for one in getattr(received.get('/markers/safety'), 'markers', ())}
        use = {one.ns for one in getattr(received.get('/markers/vehicle'), 'markers', ())}
        if complete and 'unsafe' in names and 'friction' in use:
            break
        received.clear()
        for _ in DRAWN:
            executor.spin_once(timeout_sec=0.05)
    for topic, message in received.items():
        assert conformance.check(topic, message) == [], topic
    (body,) = (one for one in received['/markers/vehicle'].markers if one.ns == 'body')
    assert body.scale.y == 1.7


def test_bags_run_tells_it_what_car_drives_and_what_is_safe():
    facts = experiment.ScenarioFacts('name', '', 'name', 0.9, {}, {}, {}, np.zeros((2, 2)), 10.0)
    chosen = experiment.controller('mpcc')
    overrides = {'controller': {'safety.obstacle_m': 0.7}}
    ring = experiment.nodes(facts, chosen, 'realtime', '/bag', '/notes', overrides)
    told = experiment.markers(ring).parameters
    assert told['mode'] == 'realtime'
    assert told['safety.obstacle_m'] == 0.7
    assert told['outline.front_m'] == pytest.approx(1.43 + 0.84)


def test_its_defaults_are_those_of_the_shipped_car():
    facts = experiment.ScenarioFacts('name', '', 'name', 1.0, {}, {}, {}, np.zeros((2, 2)), 10.0)
    ring = experiment.nodes(facts, experiment.controller('mpcc'), 'lockstep', '/b', '/n', {})
    told = experiment.markers(ring).parameters
    defaults, _ = parameters.read_file(share.path('bags', 'config', 'markers.yaml'))
    for name, value in defaults.items():
        assert told[name] == pytest.approx(value), name


def test_markers_are_topics_on_request():
    topics = contract.load().topics
    assert {name for name, topic in topics.items() if topic.on_request} == set(DRAWN)
