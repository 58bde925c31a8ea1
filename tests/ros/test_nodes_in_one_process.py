"""Recorder, scenario, controller and plant as they are, without DDS between them (`node_ring`)."""

import json
from itertools import cycle

import equal_bags
import numpy as np
import pytest
import yaml
from node_graph import assert_equal_tables, note_run
from node_ring import NodeRing
from rclpy.parameter import Parameter

from bags.report.comparison import compare_bags
from bags.storage import cdr, read
from experiments import simulation
from experiments.replay import check, recorded_ticks
from mpcc_controller import run_time_parameters
from msgs_yaml import conformance
from node_runtime.node_parameters import READ_ONLY
from node_runtime.parameters import ParameterError
from scenario_publisher import scenario
from vehicle_plant import parameters

pytestmark = [pytest.mark.smoke, pytest.mark.usefixtures('dds')]
SHORT = {'stop.x_m': 8.0, 'stop.armed_after_m': 1.0}  # half a second of driving
WHY, PREDICTIONS = '/controller/why', '/scenario/predictions'
TICK_NS = 50_000_000
CONSUMER = {'plant': {'sensors': 'sensors_consumer.yaml'}}
MULTI_BODY = {
    'plant': {'plant_params': parameters.MULTI_BODY_CAR},
    'controller': {'car_file': 'car_commonroad_320i.yaml'},
}


@pytest.mark.parametrize(
    ('name', 'settings'),
    [
        # friction patches reach the plant by another path than everything else
        pytest.param('split_mu', {}, id='patches'),
        pytest.param('double_lane_change', MULTI_BODY, id='multi-body'),
        # outages of the receiver, fixes between the ticks
        pytest.param('double_lane_change', CONSUMER, id='estimator'),
    ],
)
def test_through_the_nodes_and_in_a_simulation_the_bits_are_the_same(name, settings, tmp_path):
    ring = NodeRing(tmp_path, 'lockstep', name, **settings)
    note_run(ring.configured, tmp_path, name)
    with ring:
        bag = ring.finish()
    computed = simulation.run(simulation.prepare(name, 'mpcc', settings))
    columns = read.columns(bag)
    assert_equal_tables(computed, columns)
    if settings is CONSUMER:
        report = check.check(bag, {})
        assert report.repeatable == len(report.ticks) == len(columns[WHY].values)
        assert not report.failures


def test_predictions_and_sight_are_the_same_through_the_nodes_and_in_a_replay(tmp_path):
    """The slow vehicle, 60 m ahead at the start, is seen later, and at first hides the walker."""
    road, text = tmp_path / 'road.yaml', scenario.load('moving_obstacle').text
    text = text.replace('x_m: 170.0', 'x_m: 110.0').replace('at_s: 5.0', 'at_s: 3.5')
    view = 'stations_m: [0.0, 5.0, 30.0], ranges_m: [20.0, 20.0, 90.0], hidden_by_obstacles: true'
    road.write_text(f'{text}\npredictions: exact\nsight: {{{view}}}\n')
    ring = NodeRing(tmp_path, 'lockstep', str(road))
    note_run(ring.configured, tmp_path, str(road))
    with ring:
        bag = ring.finish()
    setup = simulation.prepare(str(road), 'mpcc')
    columns = read.columns(bag)
    computed = simulation.run(setup)
    assert_equal_tables(computed, columns)
    seen = [{o.id for o in obstacles.items} for obstacles in columns['/scenario/obstacles'].values]
    assert [seen[0], max(seen, key=len)] == [set(), {1, 2}]
    assert 72 < seen.index({1, 2}) < 90  # 3.5 s are 70 ticks
    for one, other in zip(computed[PREDICTIONS].values, columns[PREDICTIONS].values, strict=True):
        assert [*one.by_id] == [*other.by_id]
        for (a,), (b,) in zip(one.by_id.values(), other.by_id.values()):
            assert all(np.array_equal(x, y) for x, y in zip(a, b))
    ticks = recorded_ticks.read_ticks(bag)
    assert [{*tick.inputs.predictions.by_id} for tick in ticks] == seen
    assert all(tick.inputs.predictions.stamp_ns == tick.stamp_ns for tick in ticks)


def test_a_state_that_is_sent_again_until_its_first_answer_is_recorded_once(tmp_path):
    """The plant does not wait for the scenario, but the controller does."""
    bags = []
    for late in ((), ('scenario',)):
        folder = tmp_path / f'late{len(late)}'
        folder.mkdir()
        ring = NodeRing(folder, 'lockstep', 'straight', plant=SHORT)
        ring.late = late
        with ring:
            ring.spin_for(3.5)
            for role in late:
                ring.start(role)
            bags.append(equal_bags.contents(ring.finish()))
    assert equal_bags.differences(*bags) == []


def set_parameters(node, **values):
    """Return '' or why parameters, with __ for dots, are not set."""
    given = [Parameter(name.replace('__', '.'), value=value) for name, value in values.items()]
    return node.set_parameters_atomically(given).reason


def test_a_pause_and_changes_in_a_drive_are_recorded_and_replayed_exactly(tmp_path):
    ring = NodeRing(tmp_path, 'lockstep', 'double_lane_change')
    note_run(ring.configured, tmp_path, 'double_lane_change')
    with ring:
        controller = ring.nodes['controller']
        ring.spin_until(lambda: ring.is_driving(10))
        assert set_parameters(controller, tolerances__contouring_m=0.2) == ''
        refused = set_parameters(controller, tolerances__lag_m=0.0)
        assert 'allowed 0.001 to 1000 m' in refused
        assert 'read-only' in set_parameters(controller, car_file='car.yaml')
        ring.spin_until(lambda: ring.whys[-1].values['weight.con'] > 24.0)

        controller.trigger_deactivate()
        answered = len(ring.commands)
        ring.spin_for(0.2)
        assert len(ring.commands) == answered
        assert set_parameters(controller, limits__friction_use=0.9) == ''
        controller.trigger_activate()
        ring.spin_until(lambda: len(ring.commands) > answered + 10)
        bag = ring.stop_recording()

    whys = read.values(bag, WHY)
    assert {why.values['rung'] for why in whys} == {'solved'}
    assert set(np.diff([why.stamp_ns for why in whys])) == {TICK_NS}  # time waited
    ticks = recorded_ticks.read_ticks(bag)
    changes = [len(tick.inputs.changes) for tick in ticks]
    assert changes == sorted(changes)
    assert set(changes) == {0, 1, 2}
    assert ticks[-1].inputs.changes == {'tolerances.contouring_m': 0.2, 'limits.friction_use': 0.9}
    assert sum(tick.inputs.resumed for tick in ticks) == 1
    report = check.check(bag, {})
    assert len(report.ticks) == report.repeatable == len(whys)
    assert not any(tick.differing for tick in report.ticks)


def names_of(node):
    """Return the names of the parameters that are not of ROS."""
    theirs = ('use_sim_time', 'start_type_description', 'qos_overrides')
    return [n for n in node.list_parameters([], 0).names if not n.startswith(theirs)]


def test_no_state_of_the_start_is_published_once_the_run_has_begun(tmp_path):
    """A call of its timer may be queued while the first command comes."""
    with NodeRing(tmp_path, 'realtime', 'straight') as ring:
        mode, sent = ring.nodes['plant'].mode, []
        ring.spin_until(lambda: mode.timer is not None)
        publish_start = mode.timer.callback
        ring.spin_until(lambda: ring.is_driving(5))
        ring.bus.listeners['/vehicle/odometry'].append(sent.append)
        publish_start()
        assert not sent


def test_every_parameter_is_described_and_what_is_read_at_the_start_stays(tmp_path):
    with NodeRing(tmp_path, 'realtime', 'straight', **CONSUMER) as ring:
        for role, node in ring.nodes.items():
            changeable = run_time_parameters.names(node.params) if role == 'controller' else ()
            assert {'mode', 'recorders', *changeable} <= set(names_of(node))
            for name, value in zip(
                names_of(node), cycle((1.5, -1, 'other', True, [1.0], float('nan')))
            ):
                descriptor, before = node.describe_parameter(name), node.get_parameter(name).value
                assert descriptor.description, name
                assert descriptor.read_only == (name not in changeable), name
                if name not in changeable:
                    # as the service does it
                    result = node.set_parameters_atomically([Parameter(name, value=value)])
                    assert not result.successful, name
                    assert result.reason == READ_ONLY.format(name)
                    assert repr(node.get_parameter(name).value) == repr(before), name


@pytest.mark.parametrize(
    ('role', 'parameter', 'file', 'reason'),
    [
        ('scenario', 'scenario', './nowhere.yaml', 'nowhere.yaml'),
        ('controller', 'car_file', './nowhere.yaml', 'car_file: there is no file ./nowhere.yaml'),
        ('plant', 'tyre_set', './nowhere.tir', 'nowhere.tir'),
        ('recorder', 'out', '/proc/nowhere', 'out: '),
    ],
)
def test_a_wrong_file_leaves_the_node_unconfigured_with_the_reason(
    role, parameter, file, reason, tmp_path, capfd
):
    ring = NodeRing(tmp_path, 'lockstep', 'straight')
    (configured,) = (node for node in ring.configured if node.role == role)
    configured.parameters.update({parameter: file, 'autostart': False})
    with ring:
        node = ring.nodes[role]
        for _ in range(2):
            node.trigger_configure()
            assert not node.is_active
        with pytest.raises((ParameterError, ValueError), match=reason):
            raise node._failure
    text = ''.join(capfd.readouterr())
    assert text.count('configure failed: ') == 2
    assert 'Traceback' not in text


def test_a_car_that_spins_is_a_result_within_the_contract(tmp_path):
    document = yaml.safe_load(scenario.load('double_lane_change').text)
    document |= {'speed': {'constant_mps': 38.0}, 'name': 'too_fast'}
    file = tmp_path / 'too_fast.yaml'
    file.write_text(yaml.safe_dump(document))
    # the controller believes that the road is dry
    ring = NodeRing(tmp_path, 'lockstep', str(file), plant={'friction': 0.2})
    note_run(ring.configured, tmp_path, str(file))
    with ring:
        bag = ring.finish()
    compare_bags([ring.bag], tmp_path / 'report', force=True)
    comparison = json.loads((tmp_path / 'report/comparison.json').read_text())
    (run,) = comparison['runs'].values()
    assert (run['lost'], run['lost_how']) == (True, 'spun')
    assert f'spun at {run["lost_at_m"]:.0f} m' in run['verdict']
    assert 'invalid_messages' not in comparison
    assert read.columns(bag)['/vehicle/odometry'].vx_mps.min() < -5.0  # backwards
    for name in ('/vehicle/odometry', '/vehicle/wheels', '/vehicle/imu', WHY):
        topic, payloads = bag.recordings[name].topic, bag.recordings[name].payloads
        for payload in payloads[::10]:
            assert not conformance.check(name, cdr.decode(payload, topic.schema, topic.type))
