"""Managed nodes over real Fast DDS: transitions, wrong files, and a pause in a drive."""

import json
import time

import numpy as np
import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from node_graph import ROLES, NodeGraph
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from straight_road import LONG, write_straight
from wait_until import wait_until

from bags.storage import read
from experiments.configuration import inputs, node_config
from experiments.replay import check, recorded_ticks
from experiments.run import processes
from msgs_yaml import decode
from node_runtime import provenance, ros, spin_node

pytestmark = pytest.mark.usefixtures('domain')
PATIENCE_S = 60.0
COMMAND, WHY = '/controller/command', '/controller/why'
TICK_NS = 50_000_000
WAITS = {'lockstep_timeout_s': 120.0}


class Manager:
    """A lifecycle manager that a test drives."""

    def __init__(self, domain):
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node('manager', context=self.context)
        self.node.declare_parameter('mode', 'lockstep')
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def call(self, kind, name, request):
        client = self.node.create_client(kind, name)
        assert client.wait_for_service(PATIENCE_S), name
        future = client.call_async(request)
        self.executor.spin_until_future_complete(future, timeout_sec=PATIENCE_S)
        self.node.destroy_client(client)
        assert future.done(), f'{name} does not answer'
        return future.result()

    def request(self, role, transition):
        """Return whether a transition, a word or a number, was made."""
        which = {'label': transition} if isinstance(transition, str) else {'id': transition}
        request = ChangeState.Request(transition=Transition(**which))
        return self.call(ChangeState, f'/{role}/change_state', request).success

    def state(self, role):
        return self.call(GetState, f'/{role}/get_state', GetState.Request()).current_state.label

    def set(self, role, **values):
        """Return '' or why parameters, with __ for dots, are not set."""
        request = SetParameters.Request()
        for name, value in values.items():
            parameter = Parameter(name.replace('__', '.'), value=value)
            request.parameters.append(parameter.to_parameter_msg())
        results = self.call(SetParameters, f'/{role}/set_parameters', request).results
        return '; '.join(result.reason for result in results if not result.successful)

    def wait_for_messages(self, topic, enough, seconds=PATIENCE_S):
        """Subscribe to a topic until `enough(decoded messages)` is true."""
        messages, read_one = [], getattr(decode, topic.rpartition('/')[2])
        subscription = ros.subscribe(
            self.node, topic, lambda message: messages.append(read_one(message))
        )
        try:
            wait_until(
                lambda: enough(messages),
                seconds,
                lambda: f'{len(messages)} messages of {topic} are not enough',
                pause=lambda: self.executor.spin_once(timeout_sec=0.02),
            )
        finally:
            self.node.destroy_subscription(subscription)

    def close(self):
        spin_node.shut_down(self.node, context=self.context)


@pytest.fixture
def manager(domain):
    made = Manager(domain)
    yield made
    made.close()


@pytest.fixture(scope='module')
def long_road(tmp_path_factory):
    return write_straight(tmp_path_factory.mktemp('road'), LONG)  # while it is paused time waits


def note_run(graph, scenario):
    """Write the run information that a replay needs."""
    facts = inputs.load_facts(scenario)
    checked = inputs.check_parameters(graph.nodes.values())
    values = node_config.collect_parameters(graph.nodes.values(), inputs.file_values(checked))
    noted = provenance.describe_run(facts.name, facts.text, 'mpcc', 'lockstep', values)
    (graph.folder / node_config.RUN_INFO_FILE).write_text(json.dumps(noted))


def test_a_pause_and_changes_in_a_drive_are_recorded_and_replayed_exactly(
    long_road, tmp_path, domain, manager
):
    with NodeGraph(tmp_path, domain, 'lockstep', long_road, plant=WAITS) as graph:
        note_run(graph, long_road)
        for role in ROLES:
            graph.start(role)
        manager.wait_for_messages(WHY, lambda found: len(found) > 10)
        assert manager.set('controller', tolerances__contouring_m=0.2) == ''
        assert 'allowed 0.001 to 1000 m' in manager.set('controller', tolerances__lag_m=0.0)
        assert 'read-only' in manager.set('controller', car_file='car.yaml')
        manager.wait_for_messages(
            WHY, lambda found: found and found[-1].values['weight.con'] > 24.0
        )

        assert manager.request('controller', 'deactivate')
        assert manager.state('controller') == 'inactive'
        with pytest.raises(AssertionError, match='are not enough'):
            manager.wait_for_messages(COMMAND, bool, 3.0)
        assert manager.set('controller', limits__friction_use=0.9) == ''
        assert manager.request('controller', 'activate')
        manager.wait_for_messages(WHY, lambda found: len(found) > 10)
        assert graph.log('controller').count('started from the actuators') == 2
        processes.stop([graph.running['controller']])
        processes.stop([graph.running[role] for role in ('plant', 'scenario')])
        bag = graph.stop_recording()

    found = read.values(bag, WHY)
    assert {one.values['rung'] for one in found} == {'solved'}
    assert set(np.diff([one.stamp_ns for one in found])) == {TICK_NS}  # time waited
    ticks = recorded_ticks.read_ticks(bag)
    changes = [len(tick.inputs.changes) for tick in ticks]
    assert changes == sorted(changes)
    assert set(changes) == {0, 1, 2}
    assert ticks[-1].inputs.changes == {
        'tolerances.contouring_m': 0.2,
        'limits.friction_use': 0.9,
    }
    assert sum(tick.inputs.resumed for tick in ticks) == 1
    report = check.check(bag, {})
    assert len(report.ticks) == report.repeatable == len(found)
    assert not any(tick.differing for tick in report.ticks)


def start_by_hand(graph, wrong=()):
    """Start every node unconfigured; `wrong` are other parameters by role."""
    for role in ROLES:
        node = graph.nodes[role]
        values = {'autostart': False, **dict(wrong).get(role, {})}
        graph.nodes[role] = node._replace(parameters=node.parameters | values)
        graph.start(role)


def test_each_node_runs_through_its_life_cycle_and_survives_impossible_requests(
    tmp_path, domain, manager
):
    with NodeGraph(tmp_path, domain, mode='realtime') as graph:
        start_by_hand(graph)
        for role in ROLES:
            assert manager.state(role) == 'unconfigured', graph.log(role)
            assert not manager.request(role, Transition.TRANSITION_ACTIVATE)
            for transition, state in (
                ('configure', 'inactive'),
                ('activate', 'active'),
                ('deactivate', 'inactive'),
                ('activate', 'active'),
                ('deactivate', 'inactive'),
                ('cleanup', 'unconfigured'),
            ):
                assert manager.request(role, transition), graph.log(role)
                assert manager.state(role) == state
            assert 'is not possible' in graph.log(role)
            assert graph.log(role).count('inactive: it publishes nothing until it is') == 2
            assert graph.log(role).count('unconfigured: it has left the graph') == 1
        for role in ROLES:
            for transition in ('configure', 'activate'):
                assert manager.request(role, transition), graph.log(role)
        assert graph.wait('plant') == 0, graph.log('plant')
        time.sleep(0.5)  # beyond the age of a state at which the controller brakes
        assert '[ERROR]' not in graph.log('controller').rpartition(' active')[2]
        for role in ('controller', 'scenario', 'recorder'):
            assert manager.request(role, 'shutdown'), graph.log(role)
            assert manager.state(role) == 'finalized'
        assert read.load(graph.bag).run_info
        bag = read.load(f'{graph.bag}_2')  # complete, although the process goes on
        assert len(bag.recordings[COMMAND].payloads) > 20
        processes.stop([graph.running[role] for role in ('controller', 'scenario', 'recorder')])
        assert {process.code for process in graph.running.values()} == {0}


WRONG_FILES = {
    'scenario': ({'scenario': './nowhere.yaml'}, 'nowhere.yaml'),
    'controller': ({'car_file': './nowhere.yaml'}, 'car_file: there is no file ./nowhere.yaml'),
    'plant': ({'tyre_set': './nowhere.tir'}, 'nowhere.tir'),
    'recorder': ({'out': '/proc/nowhere'}, 'out: '),
}


def test_a_wrong_file_leaves_the_node_unconfigured_with_the_reason(tmp_path, domain, manager):
    with NodeGraph(tmp_path, domain) as graph:
        start_by_hand(graph, {role: values for role, (values, _) in WRONG_FILES.items()})
        for role, (_, reason) in WRONG_FILES.items():
            for _ in range(2):
                assert not manager.request(role, 'configure')
                assert manager.state(role) == 'unconfigured'
            assert graph.log(role).count('configure failed: ') == 2
            assert reason in graph.log(role)
            assert 'Traceback' not in graph.log(role)
