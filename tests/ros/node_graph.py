"""The node graph, one process per node, for tests that start and end the nodes one by one."""

import contextlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from wait_until import wait_until

from bags.storage import read, repair
from experiments.configuration import inputs, node_config
from experiments.run import processes
from msgs_yaml import decode, share
from node_runtime import provenance, ros, shutdown, spin_node

# recorded with a new stamp at each repetition, sent once in a simulation
REPEATED = {'/scenario/reference', '/scenario/road_edges'}
ROLES = ('scenario', 'controller', 'plant', 'recorder')
# mark of tests of what processes and DDS add to the nodes, which are tested in one process
# (`node_ring`) whatever changed, as is a drive of every controller over DDS (test_node_graph.py)
OF_PROCESSES = pytest.mark.reads(
    *('*_node.py', 'node_runtime/*', 'msgs_yaml/*', 'bags/bags/storage/*', 'requirements*'),
    *('experiments/experiments/run/*', 'experiments/experiments/configuration/*'),
    *('*/driving/trigger.py', '*/driving/watchdog.py', '*/driving/delay_compensation.py'),
    *('*/driving/parallel_solves.py', '*/stepping.py', '*/run_end.py', '*/compile_cache.py'),
    *('*/driving/controller.py', '*/driving/tick.py', '*/driving/last_resort.py', '*/simulator.py'),
    *('bags/bags/evaluation/bag_summary.py', '*/config/*.yaml', '*/setup.cfg', '*/launch/*'),
    *('tests/conftest.py', 'tests/ros/*', 'tests/faults/*', 'tests/helpers/*'),
)
PATIENCE_S = 60.0
LINES = 8  # of a log
NICE = -10  # on the wall clock, where the user may: other processes are not what is tested


class NodeGraph:
    """Nodes of one run on a domain of their own; a context manager that leaves no process."""

    def __init__(self, folder: Path, domain: int, mode='lockstep', road='straight', **settings):
        """`road` is a scenario, `settings` are {dotted name: value} of parameters, by role."""
        self.folder, self.running, self.mode = folder, {}, mode
        self.bag = folder / node_config.BAG_FOLDER
        nodes = inputs.build_mpcc_nodes(road, mode, folder, settings)
        self.nodes = {node.role: node for node in nodes}
        self.prefix: dict[str, list[str]] = {}  # put before the command of a role
        self.namespace = ''  # of every node, '' for the root
        # independent of the shell
        here = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        self.environment = processes.node_environment(domain, folder) | here

    def __enter__(self):
        return self

    def __exit__(self, *error):
        processes.stop(list(self.running.values()))
        print(f'logs and bag: {self.folder}')  # shown by pytest when the test fails
        if error == (None, None, None):
            for role in self.running:
                assert shutdown.TRACEBACK_START not in self.log(role), self.log(role)

    def start(self, *roles: str) -> None:
        """Start nodes."""
        for role in roles:
            node = self.nodes[role]
            program = self.prefix.get(role, []) + share.node_command(node.package, node.executable)
            in_namespace = ['-r', f'__ns:={self.namespace}'] if self.namespace else []
            self.running[role] = processes.start_node(
                node,
                self.folder,
                self.environment,
                program=program,
                extra_arguments=in_namespace,
            )
            if self.mode == 'realtime':
                group = Path('/proc', str(self.running[role].popen.pid), 'autogroup')
                with contextlib.suppress(OSError):  # each session is a group of its own
                    group.write_text(str(NICE))

    def restart(self, *roles: str) -> None:
        """Kill nodes and start them again."""
        for role in roles:
            processes.kill(self.running[role])
        self.start(*roles)

    def wait(self, role: str, seconds: float = PATIENCE_S) -> int:
        """Return the exit code of a node that ends by itself."""
        return self.running[role].popen.wait(seconds)

    def wait_for(self, role: str, text: str, seconds: float = PATIENCE_S) -> None:
        """Wait until the log of a node contains a text."""
        wait_until(
            lambda: text in self.log(role),
            seconds,
            lambda: f'the log of {role} lacks {text!r}:\n{self.log(role)}',
        )

    def finish(self) -> read.Bag:
        """Wait for the end of the run, end the other nodes in order, and read the bag."""
        assert self.wait('plant') == 0, self.log('plant')
        # the last state is answered, too
        processes.stop([self.running['controller'], self.running['scenario']])
        return self.stop_recording()

    def stop_recording(self) -> read.Bag:
        """End the recorder, repair its bag if it is incomplete, and read it."""
        processes.stop([self.running['recorder']], 20.0)
        repair.repair_bag(self.bag)
        return read.load(self.bag)

    def log_tails(self) -> str:
        """Return the last lines of every log."""
        return '\n'.join('\n'.join(self.log(role).splitlines()[-LINES:]) for role in self.running)

    def log(self, role: str) -> str:
        """Return the log of a node."""
        return self.running[role].log.read_text(errors='replace')


class Manager:
    """A lifecycle manager and listener beside the nodes, driven by a test."""

    def __init__(self, domain: int, mode: str = 'lockstep', namespace: str = '/'):
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node('manager', context=self.context, namespace=namespace)
        self.node.declare_parameter('mode', mode)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        spin_node.shut_down(self.node, context=self.context)

    def call(self, kind, name: str, request):
        """Call a service; return its answer."""
        client = self.node.create_client(kind, name)
        assert client.wait_for_service(PATIENCE_S), name
        future = client.call_async(request)
        self.executor.spin_until_future_complete(future, timeout_sec=PATIENCE_S)
        self.node.destroy_client(client)
        assert future.done(), f'{name} does not answer'
        return future.result()

    def request(self, role: str, transition: str | int) -> bool:
        """Return whether a transition, a word or a number, was made."""
        which = {'label': transition} if isinstance(transition, str) else {'id': transition}
        request = ChangeState.Request(transition=Transition(**which))
        return self.call(ChangeState, f'/{role}/change_state', request).success

    def state(self, role: str) -> str:
        """Return the state of a node."""
        return self.call(GetState, f'/{role}/get_state', GetState.Request()).current_state.label

    def wait_for_messages(
        self, topic: str, enough: Callable[[list], bool], seconds: float = PATIENCE_S
    ) -> None:
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


def note_run(
    nodes: Sequence[node_config.Node], folder: Path, scenario: str, label: str = 'mpcc'
) -> dict:
    """Write and return the run information of nodes in lockstep, that a replay needs."""
    scn = inputs.load_scenario(scenario)
    values = node_config.collect_parameters(
        nodes, inputs.file_values(inputs.check_parameters(nodes))
    )
    noted = provenance.describe_run(scn.name, scn.text, label, 'lockstep', values)
    (folder / node_config.RUN_INFO_FILE).write_text(json.dumps(noted))
    return noted


def assert_equal_tables(computed, recorded):
    """Check that the tables of a simulation and of a bag, by topic, have the same bits."""
    for topic in computed.keys() - REPEATED:
        for column, values in vars(computed[topic]).items():
            if column != 'values':
                assert np.array_equal(values, getattr(recorded[topic], column)), (topic, column)
    assert computed['/scenario/obstacles'].values == recorded['/scenario/obstacles'].values
