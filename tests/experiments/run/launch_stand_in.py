"""The few parts of `launch` and `launch_ros` (ROS 2 Jazzy) that the launch file uses.

No wheels of them exist. What decides the exit code is kept: one queue of events, whose handlers run
one after the other; an exception in a handler, or while the description is visited, is shown, shuts
down what runs and makes the exit code 1; a shutdown sends SIGINT to every process, then SIGTERM
after `sigterm_timeout`, and SIGKILL 5 s later; the service ends when nothing runs any more. SIGINT
shuts down and does not by itself change the exit code.
"""

import asyncio
import importlib.util
import os
import signal
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from types import ModuleType, SimpleNamespace

from msgs_yaml import share

SIGKILL_S = 5.0  # after SIGTERM


class LaunchDescription:
    def __init__(self, entities):
        self.entities = entities

    def execute(self, context):
        return self.entities


class DeclareLaunchArgument:
    def __init__(self, name, *, default_value, description, choices=None):
        self.name, self.default_value = name, default_value
        self.description, self.choices = description, choices

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


class SetEnvironmentVariable:
    def __init__(self, name, value):
        self.name, self.value = name, value

    def execute(self, context):
        os.environ[self.name] = self.value


class OpaqueFunction:
    def __init__(self, *, function):
        self.function = function

    def execute(self, context):
        return self.function(context)


class LogInfo:
    def __init__(self, *, msg):
        self.msg = msg

    def execute(self, context):
        print(f'[INFO] [launch.user]: {self.msg}', flush=True)


class Shutdown:
    def __init__(self, *, reason):
        self.reason = reason

    def execute(self, context):
        context.service.shut_down()


class Node:
    def __init__(
        self,
        *,
        package,
        executable,
        namespace,
        parameters,
        ros_arguments,
        output,
        prefix,
        sigterm_timeout,
        on_exit,
    ):
        program = [*prefix.split(), *share.node_command(package, executable)]
        self.command = [*program, '--ros-args', *ros_arguments]
        if namespace:
            self.command += ['-r', f'__ns:=/{namespace.lstrip("/")}']
        for file in parameters:
            self.command += ['--params-file', file]
        self.patience_s, self.on_exit = float(sigterm_timeout), on_exit
        self.process = None

    def execute(self, context):
        if not context.is_shutdown:
            context.service.nodes.append(self)
            context.service.begin(self._run(context))

    async def _run(self, context):
        self.process = await asyncio.create_subprocess_exec(*self.command)
        if context.is_shutdown:
            self.shut_down(context)
        code = await self.process.wait()
        event = SimpleNamespace(returncode=code)
        context.service.events.put_nowait(lambda: self.on_exit(event, context))

    def shut_down(self, context):
        if self.process is not None and self.process.returncode is None:
            context.service.begin(self._end())

    async def _end(self):
        after = (
            (signal.SIGINT, self.patience_s),
            (signal.SIGTERM, SIGKILL_S),
            (signal.SIGKILL, None),
        )
        for number, patience_s in after:
            if self.process.returncode is not None:
                return
            # Process.send_signal reaps an ended child, whose exit code asyncio then never learns
            with suppress(ProcessLookupError):
                os.kill(self.process.pid, number)
            await asyncio.wait([asyncio.create_task(self.process.wait())], timeout=patience_s)


class LaunchService:
    """Runs one description; `run` returns the exit code."""

    def __init__(self, arguments):
        self.nodes, self.tasks, self.return_code = [], set(), 0
        self.context = SimpleNamespace(
            launch_configurations=dict(arguments), is_shutdown=False, service=self
        )

    def begin(self, coroutine):
        self.tasks.add(asyncio.get_running_loop().create_task(coroutine))

    def shut_down(self):
        if not self.context.is_shutdown:
            self.context.is_shutdown = True
            for node in self.nodes:
                node.shut_down(self.context)

    async def run(self, description):
        self.events = asyncio.Queue()
        asyncio.get_running_loop().add_signal_handler(signal.SIGINT, self.shut_down)
        self.events.put_nowait(lambda: description)
        while self.tasks or not self.events.empty():
            if self.events.empty():
                event = asyncio.ensure_future(self.events.get())
                await asyncio.wait(self.tasks | {event}, return_when=asyncio.FIRST_COMPLETED)
                handler = event.result() if event.done() else event.cancel() and None
            else:
                handler = self.events.get_nowait()
            if handler is not None:
                self._handle(handler)
            for task in [task for task in self.tasks if task.done()]:
                self.tasks.remove(task)
                task.result()
        return self.return_code

    def _handle(self, handler):
        try:
            self._visit(handler())
        except Exception as error:
            print(f'[ERROR] [launch]: Caught exception in launch: {error}', file=sys.stderr)
            self.return_code = 1
            self.shut_down()

    def _visit(self, entities):
        for entity in entities if isinstance(entities, list) else [entities]:
            if entity is not None:
                self._visit(entity.execute(self.context))


def install() -> None:
    """Make the names of this module those of `launch` and `launch_ros`."""
    folder = tempfile.mkdtemp(prefix='launch_', dir=os.environ.get('ROS_LOG_DIR'))
    logging = {'launch_config': SimpleNamespace(log_dir=folder)}
    actions = (
        DeclareLaunchArgument,
        LogInfo,
        OpaqueFunction,
        SetEnvironmentVariable,
        Shutdown,
    )
    contents = {
        'launch': {'LaunchDescription': LaunchDescription},
        'launch.actions': {action.__name__: action for action in actions},
        'launch.logging': logging,
        'launch.substitutions': {'LaunchConfiguration': LaunchConfiguration},
        'launch_ros': {},
        'launch_ros.actions': {'Node': Node},
    }
    for name, names in contents.items():
        sys.modules[name] = ModuleType(name)
        vars(sys.modules[name]).update(names)


def run(file: Path, arguments: dict[str, str]) -> int:
    """Run a launch file as `ros2 launch FILE name:=value ...` does; return the exit code."""
    install()
    spec = importlib.util.spec_from_file_location('launch_file', file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return asyncio.run(LaunchService(arguments).run(module.generate_launch_description()))
