"""Nodes that start in any order, and on two hosts. Real Fast DDS."""

import itertools
import os
import random
import subprocess
import time

import commit_seed
import numpy as np
import pytest
from capabilities import report_missing, require
from node_graph import OF_PROCESSES, ROLES, NodeGraph
from wait_until import wait_until

from bags.storage import read
from experiments.run import processes

pytestmark = [pytest.mark.usefixtures('domain'), OF_PROCESSES]
END_S = 60.0  # a node may take to end, on a busy machine
# one in which the path is there before the controller is, and another one for each commit
LATE_CONTROLLER = ('scenario', 'recorder', 'plant', 'controller')
ORDERS = [order for order in itertools.permutations(ROLES) if order != LATE_CONTROLLER]
random.Random(commit_seed.seed('ORDER_SEED')).shuffle(ORDERS)
NIGHTLY = [pytest.param(order, marks=pytest.mark.nightly) for order in ORDERS[1:]]
SHORT = {'plant': {'stop.x_m': 8.0, 'stop.armed_after_m': 1.0}}  # half a second of driving


@pytest.mark.parametrize('order', [LATE_CONTROLLER, ORDERS[0], *NIGHTLY], ids='-'.join)
def test_a_run_completes_in_any_order_of_starting_the_nodes(order, tmp_path, domain):
    with NodeGraph(tmp_path, domain, **SHORT) as graph:
        for role in order:
            graph.start(role)
            wait_until(lambda role=role: graph.log(role), END_S, f'{role} does not start')
        columns = read.columns(graph.finish(), ['/vehicle/odometry', '/controller/command'])
    stamps = columns['/vehicle/odometry'].stamp_ns
    assert np.array_equal(np.diff(stamps), np.full(len(stamps) - 1, 1_000_000))
    answers = columns['/controller/command'].stamp_ns
    assert answers[0] == stamps[0]
    assert np.array_equal(np.diff(answers), np.full(len(answers) - 1, 50_000_000))


@pytest.fixture
def hosts():
    """Make two network namespaces that a cable joins; needs root."""
    require('namespaces')
    # names of this process: tests may run beside each other
    hosts = [f'graph{os.getpid()}{letter}' for letter in 'ab']
    ends = [f'e{host}' for host in hosts]

    def ip(*words):
        return subprocess.run(['ip', *words], capture_output=True, text=True, timeout=240)

    results = [ip('netns', 'add', host) for host in hosts]
    results.append(ip('link', 'add', ends[0], 'type', 'veth', 'peer', 'name', ends[1]))
    for number, (host, end) in enumerate(zip(hosts, ends), start=1):
        results.append(ip('link', 'set', end, 'netns', host))
        inside = ('-n', host)
        results.append(ip(*inside, 'addr', 'add', f'10.99.0.{number}/24', 'dev', end))
        results.append(ip(*inside, 'link', 'set', 'lo', 'up'))
        results.append(ip(*inside, 'link', 'set', end, 'up'))
        results.append(ip(*inside, 'route', 'add', '224.0.0.0/4', 'dev', end))
    try:
        refused = [result.stderr for result in results if result.returncode]
        if refused:
            report_missing('namespaces', refused[0])
        yield hosts
    finally:
        for host in hosts:
            ip('netns', 'delete', host)


def test_nodes_on_two_hosts_form_one_node_graph_where_the_user_asks_for_it(hosts, tmp_path, domain):
    there = dict(zip(ROLES, (hosts[0], hosts[0], hosts[1], hosts[1])))
    with NodeGraph(tmp_path, domain, **SHORT) as graph:
        graph.prefix = {role: ['ip', 'netns', 'exec', host] for role, host in there.items()}
        del graph.environment['ROS_AUTOMATIC_DISCOVERY_RANGE']
        graph.start(*ROLES)
        # on its own host the controller has found the path; from the other one nothing comes
        graph.wait_for('controller', 'waiting for obstacles, vehicle state')
        time.sleep(2.0)
        assert 'vehicle state' in processes.last_line(graph.running['controller'].log)
        processes.stop(list(graph.running.values()))
        graph.environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SUBNET'
        graph.bag = tmp_path / 'second'
        recorder = graph.nodes['recorder']
        graph.nodes['recorder'] = recorder._replace(
            parameters=recorder.parameters | {'out': str(graph.bag)}
        )
        graph.start(*ROLES)
        columns = read.columns(graph.finish(), ['/controller/command'])
    assert len(columns['/controller/command'].stamp_ns) > 5
