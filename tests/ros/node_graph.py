"""The node graph, one process per node, for tests that start and end the nodes one by one."""

import contextlib
from collections.abc import Callable
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.task import Future
from wait_until import wait_until

from bags.storage import read, repair
from experiments.configuration import inputs, node_config
from experiments.run import processes
from msgs_yaml import decode, share
from node_runtime import ros, shutdown, spin_node

# topics whose messages have numeric columns
NUMERIC = (
    '/vehicle/odometry',
    '/vehicle/actuators',
    '/vehicle/imu',
    '/vehicle/wheels',
    '/controller/command',
)
ROLES = ('scenario', 'controller', 'plant', 'recorder')
LINES = 8  # of a log
NICE = -10  # on the wall clock, where the user may: other processes are not what is tested


class NodeGraph:
    """Nodes of one run on a domain of their own; a context manager that leaves no process."""

    def __init__(self, folder: Path, domain: int, mode='lockstep', road='straight', **settings):
        """`road` is a scenario, `settings` are {dotted name: value} of parameters, by role."""
        self.folder, self.running, self.mode = folder, {}, mode
        self.bag = folder / node_config.BAG_FOLDER
        facts = inputs.load_facts(road)
        nodes = node_config.build_mpcc_nodes(facts, mode, folder, settings)
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

    def start(self, role: str) -> processes.Process:
        """Start a node."""
        node = self.nodes[role]
        program = self.prefix.get(role, []) + share.node_command(node.package, node.executable)
        more = ['-r', f'__ns:={self.namespace}'] if self.namespace else []
        self.running[role] = processes.start_node(
            node, self.folder, self.environment, program=program, extra_arguments=more
        )
        if self.mode == 'realtime':
            group = Path('/proc', str(self.running[role].popen.pid), 'autogroup')
            with contextlib.suppress(OSError):  # each session is a group of its own
                group.write_text(str(NICE))
        return self.running[role]

    def wait(self, role: str, seconds: float = 60.0) -> int:
        """Return the exit code of a node that ends by itself."""
        return self.running[role].popen.wait(seconds)

    def wait_for(self, role: str, text: str, seconds: float = 60.0) -> None:
        """Wait until the log of a node contains a text."""
        wait_until(
            lambda: text in self.log(role),
            seconds,
            lambda: f'the log of {role} lacks {text!r}:\n{self.log(role)}',
        )

    def wait_for_messages(
        self, topic: str, enough: Callable[[list], bool], seconds: float = 60.0
    ) -> None:
        """Subscribe to a topic until `enough(decoded messages)` is true."""
        context = Context()
        rclpy.init(context=context, domain_id=int(self.environment['ROS_DOMAIN_ID']))
        node = rclpy.create_node('listener', context=context, start_parameter_services=False)
        node.declare_parameter('mode', self.mode)
        messages, read_one = [], getattr(decode, topic.rpartition('/')[2])
        ros.subscribe(node, topic, lambda message: messages.append(read_one(message)))
        executor = EventsExecutor(context=context)
        executor.add_node(node)
        try:
            wait_until(
                lambda: enough(messages),
                seconds,
                lambda: f'{len(messages)} messages of {topic} are not enough:\n{self.log_tails()}',
                pause=lambda: executor.spin_until_future_complete(Future(), timeout_sec=0.02),
            )
        finally:
            executor.remove_node(node)
            spin_node.shut_down(node, context=context)

    def log_tails(self) -> str:
        """Return the last lines of every log."""
        return '\n'.join('\n'.join(self.log(role).splitlines()[-LINES:]) for role in self.running)

    def log(self, role: str) -> str:
        """Return the log of a node."""
        return self.running[role].log.read_text(errors='replace')

    def stop_recording(self) -> read.Bag:
        """End the recorder, repair its bag if it is incomplete, and read it."""
        processes.stop([self.running['recorder']], 20.0)
        repair.repair_bag(self.bag)
        return read.load(self.bag)
