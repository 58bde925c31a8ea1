"""The estimator between sensors and controller: on the wall clock in one process, and over DDS."""

from types import SimpleNamespace as Has

import numpy as np
import pytest
from node_graph import OF_PROCESSES, NodeGraph, assert_equal_tables
from node_ring import NodeRing, Relay

from bags.storage import read
from experiments import simulation
from msgs_yaml import decode
from msgs_yaml.conversions import NS_PER_S
from node_runtime.clocks import SteadyClock
from node_runtime.input_monitor import OK, WARN
from state_estimator.estimator_node import EstimatorNode

pytestmark = [pytest.mark.smoke, pytest.mark.usefixtures('dds')]
TRUTH, BELIEVED = '/vehicle/odometry', '/estimator/odometry'
INERTIAL, GNSS = '/sensors/inertial', '/sensors/gnss'
PLANNED = {'solved', 'stopped_early'}
SENSORS = {'plant': {'sensors': 'sensors_automotive.yaml'}}
STATES = ('x_m', 'y_m', 'yaw_rad', 'vx_mps', 'vy_mps', 'yaw_rate_radps')
SDS = ('x_m2', 'y_m2', 'yaw_rad2', 'vx_m2ps2', 'vy_m2ps2', 'yaw_rate_rad2ps2')


def silence(ring, topic, seconds):
    """Let time go on while no message of a topic arrives."""
    ring.bus.relays[topic] = Relay(lambda *_: [], '', lambda: True)
    ring.spin_for(seconds)
    del ring.bus.relays[topic]


def errors(bag):
    """Return errors and standard deviations (n, 6) of the estimates of the drive."""
    columns = read.columns(bag, [TRUTH, BELIEVED])
    true, believed = columns[TRUTH], columns[BELIEVED]
    driven = np.isin(believed.stamp_ns, true.stamp_ns)
    at = np.searchsorted(true.stamp_ns, believed.stamp_ns[driven])
    error = [getattr(believed, n)[driven] - getattr(true, n)[at] for n in STATES]
    sd = [np.sqrt(getattr(believed, f'var_{name}')[driven]) for name in SDS]
    return np.array(error).T, np.array(sd).T


def healths(bag):
    return [h for h in read.values(bag, '/diagnostics') if h.name == 'estimator']


def test_on_the_wall_clock_the_car_is_driven_by_what_it_measures(tmp_path):
    """Held at its start at speed, too; then the drive begins without a jump."""
    with NodeRing(tmp_path, 'realtime', 'straight', **SENSORS) as ring:
        bag = ring.finish()
        assert 'finish line crossed' in ring.stepper.outcome.message
    error, sd = errors(bag)
    assert {why.values['rung'] for why in ring.whys} <= PLANNED
    answered = {command.stamp_ns for command in ring.commands}
    assert answered <= {*read.columns(bag, [BELIEVED])[BELIEVED].stamp_ns.tolist()}
    assert np.abs(error[:, :2]).max() < 0.3
    assert (np.abs(error) <= 3 * sd).mean() > 0.95
    assert {health.level for health in healths(bag)} == {OK}


def test_what_falls_silent_is_named_and_a_pause_of_the_imu_begins_anew(tmp_path):
    with NodeRing(tmp_path, 'realtime', 'straight', **SENSORS) as ring:
        ring.spin_until(lambda: ring.is_driving(5))
        node = ring.nodes['estimator']
        assert (node.params.car.mass_kg, node.params.imu_s) == (1850.0, 0.005)
        before = node.stream.estimate
        silence(ring, GNSS, 1.5)
        blind = node.stream.estimate
        assert blind.status == 'no receiver'
        assert np.all(np.diag(blind.covariance)[:2] > 2 * np.diag(before.covariance)[:2])
        assert {why.values['rung'] for why in ring.whys} <= PLANNED
        silence(ring, INERTIAL, 0.3)
        assert ring.whys[-1].values['reason'] == 'state_stale'
        ring.spin_until(lambda: ring.is_driving(3))
        assert node.stream.resets == 1
        bag = ring.finish()
    error, _ = errors(bag)
    assert np.abs(error[-1, :2]).max() < 0.3
    faults = [health.message for health in healths(bag) if health.level == WARN]
    assert faults[0] == 'no receiver'
    assert any('between two messages of the IMU' in text for text in faults)
    assert healths(bag)[-1].values['begun_anew'] == 1


def test_an_outage_that_comes_again_is_told_again_and_another_run_begins_well():
    told, sent = [], []
    stream = Has(resets=0, estimate=None, begin=lambda: None)
    node = Has(
        stream=stream, wall=SteadyClock(), reported_ns=0, health_pub=Has(publish=sent.append)
    )
    node.get_logger = lambda: Has(warning=told.append)
    node.publishers_of = Has(add_warnings=lambda health: health)
    EstimatorNode.begin(node)
    for second, status in enumerate(['no receiver', 'ok', 'no receiver', 'no receiver'], 1):
        EstimatorNode.report(node, second * NS_PER_S, status)
    assert told == ['no receiver'] * 2
    EstimatorNode.begin(node)
    EstimatorNode.report(node, 5 * NS_PER_S, 'ok')
    ((*_, last),) = (decode.health(message) for message in sent[-1:])
    assert (last.level, last.message) == (OK, 'estimating')


def test_an_estimator_without_a_car_withdraws_its_odometry(tmp_path):
    with NodeRing(tmp_path, 'realtime', 'straight', **SENSORS) as ring:
        ring.spin_until(lambda: ring.is_driving(3))
        plant = ring.nodes['plant']
        for pub in plant.sensor_pubs.values():
            plant.destroy_lifecycle_publisher(pub.publisher)
        ring.spin_until(lambda: ring.nodes['estimator'].odometry_pub is None)
        assert not ring.nodes['controller'].inputs.has_vehicle()


@OF_PROCESSES
def test_over_dds_in_a_namespace_the_bits_are_those_of_a_simulation(domain, tmp_path):
    with NodeGraph(tmp_path, domain, **SENSORS) as graph:
        graph.namespace = '/car1'
        graph.start(*graph.nodes)
        bag = graph.finish()
    assert_equal_tables(
        simulation.run(simulation.prepare('straight', 'mpcc', SENSORS)), read.columns(bag)
    )
