"""The few parts of `launch` and `launch_ros` (ROS 2 Jazzy) that the launch file uses.

No wheels of them exist. What decides the exit code is kept: handlers run one after the other; an
exception in a handler, or while the description is visited, is shown, shuts down what runs and
makes the exit code 1; a shutdown sends SIGINT to every process, then SIGTERM after
`sigterm_timeout`, and SIGKILL 5 s later; it ends when nothing runs any more. SIGINT shuts down and
does not by itself change the exit code.
"""

import importlib.util
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace

from msgs_yaml import share

SIGKILL_S = 5.0  # after SIGTERM
POLL_S = 0.02


class Action(SimpleNamespace):
    """Something that is executed when it is visited; it keeps what it is given by name."""

    def execute(self, context):
        return None


class DeclareLaunchArgument(Action):
    def __init__(self, name, **given):
        super().__init__(name=name, **given)

    def execute(self, context):
        value = context.launch_configurations.setdefault(self.name, self.default_value)
        if self.choices is not None and value not in self.choices:
            raise RuntimeError(
                f'Argument "{self.name}" provided value "{value}" is not valid. '
                f'Valid options are: {self.choices}'
            )


class LaunchConfiguration:
    def __init__(self, name):
        self.name = name

    def perform(self, context):
        return context.launch_configurations[self.name]


class LogInfo(Action):
    def execute(self, context):
        print(f'[INFO] [launch.user]: {self.msg}', flush=True)


class Shutdown(Action):
    def execute(self, context):
        context.is_shutdown = True


class Node(Action):
    def execute(self, context):
        if context.is_shutdown:
            return
        command = [*self.prefix.split(), *share.node_command(self.package, self.executable)]
        command += ['--ros-args', *self.ros_arguments]
        if self.namespace:
            command += ['-r', f'__ns:=/{self.namespace.lstrip("/")}']
        for file in self.parameters:
            command += ['--params-file', file]
        patience_s = float(self.sigterm_timeout)
        # what is still to be sent, and how long after the shutdown
        self.signals = [
            (0.0, signal.SIGINT),
            (patience_s, signal.SIGTERM),
            (patience_s + SIGKILL_S, signal.SIGKILL),
        ]
        self.process = subprocess.Popen(command)
        context.running.append(self)


def install() -> None:
    """Make the names of this module those of `launch` and `launch_ros`."""
    folder = tempfile.mkdtemp(prefix='launch_', dir=os.environ.get('ROS_LOG_DIR'))
    contents = {
        'launch': {'LaunchDescription': lambda entities: Action(execute=lambda _: entities)},
        'launch.actions': {
            'DeclareLaunchArgument': DeclareLaunchArgument,
            'LogInfo': LogInfo,
            'OpaqueFunction': lambda function: Action(execute=function),
            'SetEnvironmentVariable': lambda name, value: Action(
                execute=lambda _: os.environ.update({name: value})
            ),
            'Shutdown': Shutdown,
        },
        'launch.logging': {'launch_config': SimpleNamespace(log_dir=folder)},
        'launch.substitutions': {'LaunchConfiguration': LaunchConfiguration},
        'launch_ros': {},
        'launch_ros.actions': {'Node': Node},
    }
    for name, names in contents.items():
        sys.modules[name] = ModuleType(name)
        vars(sys.modules[name]).update(names)


def visit(entities, context) -> None:
    """Execute what a description or a handler gives, and what that gives."""
    for entity in entities if isinstance(entities, list) else [entities]:
        if entity is not None:
            visit(entity.execute(context), context)


def run(file: Path, arguments: dict[str, str]) -> int:
    """Run a launch file as `ros2 launch FILE name:=value ...` does; return the exit code."""
    install()
    spec = importlib.util.spec_from_file_location('launch_file', file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    context = SimpleNamespace(launch_configurations=dict(arguments), is_shutdown=False, running=[])
    return_code, handlers, ended_s = 0, [module.generate_launch_description], None
    before = signal.signal(signal.SIGINT, lambda *_: setattr(context, 'is_shutdown', True))
    try:
        while handlers or context.running:
            for handler in handlers:
                try:
                    visit(handler(), context)
                except Exception as error:
                    print(f'[ERROR] [launch]: Caught exception in launch: {error}', file=sys.stderr)
                    return_code, context.is_shutdown = 1, True
            if context.is_shutdown:
                ended_s = ended_s or time.monotonic()
                for node in context.running:
                    while node.signals and time.monotonic() >= ended_s + node.signals[0][0]:
                        node.process.send_signal(node.signals.pop(0)[1])
            time.sleep(POLL_S)
            gone = [node for node in context.running if node.process.poll() is not None]
            context.running = [node for node in context.running if node not in gone]
            handlers = [lambda node=node: _exited(node, context) for node in gone]
    finally:
        signal.signal(signal.SIGINT, before)
    return return_code


def _exited(node, context):
    return node.on_exit(SimpleNamespace(returncode=node.process.returncode), context)
