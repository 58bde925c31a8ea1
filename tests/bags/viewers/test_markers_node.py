"""markers_node over real Fast DDS: it draws what it sees, and holds nobody up."""

import itertools
import signal
import time

import numpy as np
import pytest
from wait_until import wait_until

from experiments.configuration import inputs, node_config
from msgs_yaml import conformance, encode, share
from msgs_yaml.types import Obstacle, Obstacles, Prediction, VehicleState, Why
from node_runtime import parameters, ros
from scenario_publisher import scenario

CUT = bytes.fromhex('00010000ff')  # no message of any type
SECONDS = 60.0
S = 1_000_000_000
DRAWN = ('/markers/vehicle', '/markers/safety', '/markers/prediction')


def sent(k):
    """Return what the ring says at its tick `k`."""
    t, stages = S + 50_000_000 * k, np.arange(51) * 0.05
    obstacle = Obstacle(3, 60.0, 0.0, 1.0, 0.0, 0.0)
    ahead = Prediction(t, 20.0 * stages, 0.0 * stages, 0.0 * stages, stages)
    return {
        '/scenario/obstacles': encode.obstacles(Obstacles(t, (obstacle,))),
        '/controller/why': encode.why(Why(t, 0, 'solved', {'friction.front': 0.5})),
        '/controller/prediction': encode.prediction(ahead),
        '/vehicle/odometry': encode.odometry(VehicleState(t, 1.0, 2.0, 0.0, 20.0, 0.0, 0.0)),
    }


def is_complete(received):
    """Tell whether everything that the ring says has been drawn."""
    kinds = {t: {item.ns for item in message.markers} for t, message in received.items()}
    return kinds.keys() == set(DRAWN) and (
        'unsafe' in kinds['/markers/safety'] and 'friction' in kinds['/markers/vehicle']
    )


def test_it_draws_the_ring_with_its_own_parameters_and_outlives_bad_messages(start_node, make_ring):
    process = start_node('bags.markers_node', namespace='/car1', **{'outline.width_m': 1.7})
    ring, received, ticks = make_ring('lockstep', '/car1'), {}, itertools.count()
    for topic in DRAWN:
        ros.subscribe(ring.node, topic, lambda message, t=topic: received.update({t: message}))

    def publish_until(done, cut=False):
        def tick():
            for topic, message in sent(next(ticks)).items():
                ring.publishers[topic].publish(CUT if cut else message)
            end = time.monotonic() + 0.05
            while time.monotonic() < end:
                ring.executor.spin_once(timeout_sec=0.01)

        wait_until(done, SECONDS, lambda: str(received.keys()), pause=tick)

    publish_until(lambda: is_complete(received))
    bad = iter(range(20))
    publish_until(lambda: next(bad, None) is None, cut=True)
    received.clear()
    publish_until(lambda: is_complete(received))
    for topic, message in received.items():
        assert conformance.check(topic, message) == [], topic
    (body,) = (item for item in received['/markers/vehicle'].markers if item.ns == 'body')
    assert body.scale.y == 1.7
    assert process.end(signal.SIGTERM)[0] == 0


def test_experiments_run_tells_it_what_car_drives_and_what_is_safe():
    scn = scenario.load('straight')
    mpcc = node_config.find_controller('mpcc')

    def told(mode, **overrides):
        ring = inputs.build_nodes(scn, 'straight', mpcc, overrides, mode=mode)
        return node_config.build_markers_node(ring).parameters

    text = told('realtime', controller={'safety.obstacle_m': 0.7})
    assert (text['mode'], text['safety.obstacle_m']) == ('realtime', 0.7)
    # its defaults are those of the shipped car
    shipped = told('lockstep')
    defaults = parameters.read_file(share.path('bags', 'config', 'markers.yaml')).values
    assert {name: shipped[name] for name in defaults} == pytest.approx(defaults)
