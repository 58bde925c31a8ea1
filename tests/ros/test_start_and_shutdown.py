"""Nodes that start in any order, and what remains after their shutdown. Real Fast DDS."""

import itertools
import os
import random
import signal
import subprocess
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from capabilities import report_missing, require
from file_locks import is_locked
from node_graph import ROLES, NodeGraph
from wait_until import wait_until

from bags.storage import read
from experiments.run import processes
from experiments.run.domain import reserved
from node_runtime.parameters import RUN_TIME
from stage_solver import compile_cache

pytestmark = pytest.mark.usefixtures('domain')
END_S = 60.0  # a node may take to end, on a busy machine
COMPILE_S = 120.0  # other programs may compile, on a busy machine
GAP_S = 0.3  # between two starts
# the checks take a seeded few, ALL_ORDERS=1 takes every one
ORDERS = list(itertools.permutations(ROLES))
if 'ALL_ORDERS' not in os.environ:
    ORDERS = random.Random(1).sample(ORDERS, 4)
SHORT = {'plant': {'stop.x_m': 8.0, 'stop.armed_after_m': 1.0}}  # half a second of driving


@pytest.mark.parametrize('order', ORDERS, ids='-'.join)
def test_a_run_completes_in_any_order_of_starting_the_nodes(order, tmp_path, domain):
    with NodeGraph(tmp_path, domain, **SHORT) as graph:
        for role in order:
            graph.start(role)
            time.sleep(GAP_S)
        assert graph.wait('plant') == 0, graph.log('plant')
        columns = read.columns(graph.stop_recording(), ['/vehicle/odometry', '/controller/command'])
    stamps = columns['/vehicle/odometry'].stamp_ns
    assert np.array_equal(np.diff(stamps), np.full(len(stamps) - 1, 1_000_000))
    answers = columns['/controller/command'].stamp_ns
    assert answers[0] == stamps[0]
    assert np.array_equal(np.diff(answers), np.full(len(answers) - 1, 50_000_000))


def test_two_node_graphs_on_two_domains_are_isolated(tmp_path, domain):
    ends = {'short': 8.0, 'long': 20.0}  # x at which the run ends
    with reserved({}) as other, ExitStack() as both:
        graphs = {}
        for (name, x_m), number in zip(ends.items(), (domain, other)):
            (tmp_path / name).mkdir()
            plant = SHORT['plant'] | {'stop.x_m': x_m}
            graph = NodeGraph(tmp_path / name, number, plant=plant)
            graphs[name] = both.enter_context(graph)
        for role in ROLES:
            for graph in graphs.values():
                graph.start(role)
        for name, graph in graphs.items():
            assert graph.wait('plant') == 0, graph.log('plant')
            columns = read.columns(
                graph.stop_recording(), ['/vehicle/odometry', '/controller/command']
            )
            for topic, step_ns in (('/vehicle/odometry', 1), ('/controller/command', 50)):
                steps = np.diff(columns[topic].stamp_ns)
                assert np.all(steps == step_ns * 1_000_000), f'{name}: two publishers on {topic}'
            assert columns['/vehicle/odometry'].x_m[-1] == pytest.approx(ends[name], abs=2.0)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_signal_ends_each_node_and_leaves_nothing(number, tmp_path, domain):
    slow = {'plant': {'stop.x_m': 1e4, 'stop.time_s': RUN_TIME.high}}
    with NodeGraph(tmp_path, domain, mode='realtime', **slow) as graph:
        for role in ROLES:
            graph.start(role)
        graph.wait_for('controller', 'started from the actuators')
        time.sleep(1.0)
        for role in ('plant', 'controller', 'scenario', 'recorder'):
            process = graph.running[role]
            # shared memory of a killed process would cut off the one that takes its place
            maps = Path('/proc', str(process.popen.pid), 'maps').read_text()
            assert '/dev/shm/fastrtps_' not in maps
            process.popen.send_signal(number)
            code = process.popen.wait(END_S)
            assert code == (-number if number == signal.SIGKILL else 0), graph.log(role)
            with pytest.raises(ProcessLookupError):  # nobody is left in its session
                os.killpg(process.popen.pid, 0)
        bag = graph.stop_recording()
    assert len(bag.recordings['/vehicle/odometry'].payloads) > 500
    locks = list(compile_cache.cache_dir().glob('*.lock'))  # other programs may compile just now
    wait_until(
        lambda: not any(map(is_locked, locks)), COMPILE_S, 'a lock on the compile cache is held'
    )


@pytest.fixture
def hosts():
    """Make two network namespaces that a cable joins; needs root."""
    require('namespaces')
    # names of this process: tests may run beside each other
    hosts = [f'graph{os.getpid()}{letter}' for letter in 'ab']
    ends = [f'e{host}' for host in hosts]

    def ip(*words):
        return subprocess.run(['ip', *words], capture_output=True, text=True, timeout=240)

    made = [ip('netns', 'add', host) for host in hosts]
    made.append(ip('link', 'add', ends[0], 'type', 'veth', 'peer', 'name', ends[1]))
    for number, (host, end) in enumerate(zip(hosts, ends), start=1):
        made.append(ip('link', 'set', end, 'netns', host))
        inside = ('-n', host)
        made.append(ip(*inside, 'addr', 'add', f'10.99.0.{number}/24', 'dev', end))
        made.append(ip(*inside, 'link', 'set', 'lo', 'up'))
        made.append(ip(*inside, 'link', 'set', end, 'up'))
        made.append(ip(*inside, 'route', 'add', '224.0.0.0/4', 'dev', end))
    try:
        refused = [one.stderr for one in made if one.returncode]
        if refused:
            report_missing('namespaces', refused[0])
        yield hosts
    finally:
        for host in hosts:
            ip('netns', 'delete', host)


def test_nodes_on_two_hosts_form_one_node_graph(hosts, tmp_path, domain):
    there = dict(zip(ROLES, (hosts[0], hosts[0], hosts[1], hosts[1])))
    with NodeGraph(tmp_path, domain, **SHORT) as graph:
        graph.environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SUBNET'
        for role in ROLES:
            graph.prefix[role] = ['ip', 'netns', 'exec', there[role]]
            graph.start(role)
        assert graph.wait('plant', 100.0) == 0, graph.log('plant')
        # as in `experiments run`: it waits for what the cable lost and is sent again
        processes.stop([graph.running[role] for role in ('controller', 'scenario')])
        columns = read.columns(graph.stop_recording(), ['/controller/command'])
    assert len(columns['/controller/command'].stamp_ns) > 5


def test_by_default_nodes_on_two_hosts_do_not_see_each_other(hosts, tmp_path, domain):
    with NodeGraph(tmp_path, domain, **SHORT) as graph:
        graph.prefix = {'scenario': ['ip', 'netns', 'exec', hosts[0]]}
        graph.prefix |= {'controller': ['ip', 'netns', 'exec', hosts[1]]}
        del graph.environment['ROS_AUTOMATIC_DISCOVERY_RANGE']
        for role in ('scenario', 'controller'):
            graph.start(role)
        graph.wait_for('controller', 'ready')
        time.sleep(3.0)
        assert 'waiting for path' in processes.last_line(graph.running['controller'].log)
