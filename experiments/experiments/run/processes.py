"""Programs and nodes as processes: start, watch and stop them; signals to this program.

Each process has a log file and a session of its own and is ended by its process id. Signals are
flags to poll, so that they never interrupt the start of a node or a file write.
"""

import contextlib
import ctypes
import os
import signal
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from experiments.configuration import node_config
from experiments.configuration.node_config import Node
from msgs_yaml import share
from node_runtime import shutdown

INTERRUPT_S = 12.0  # to end after SIGINT: the last messages take 5 s at most, shutdown 4
PR_SET_PDEATHSIG = 1  # linux/prctl.h
AUTOGROUP = Path('/proc/self/autogroup')
# for every node, unless the user's environment sets it: discovery on this machine only
DEFAULT_ENVIRONMENT = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
# for every node: one thread, the matrices are small
FIXED_ENVIRONMENT = {'OPENBLAS_NUM_THREADS': '1'}
TAIL_LINES = 15
TAIL_BYTES = 2000
# exit code that shells report for a program ended by a signal: this plus its number
SHELL_SIGNAL = 128
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
POLL_S = 0.1


class ProcessError(RuntimeError):
    """A program ended too early; the message shows its last lines."""


class Process(NamedTuple):
    """A started program and its log file."""

    name: str
    popen: subprocess.Popen
    log: Path

    @property
    def code(self) -> int | None:
        """The exit code: None while it runs, negative for a signal."""
        return self.popen.poll()


def start(
    name: str,
    command: Sequence[str],
    log: Path,
    environment: Mapping[str, str],
    cores: set[int] | None = None,
    nice: int = 0,
) -> Process:
    """Start a program with its output, unbuffered, in `log`.

    `cores` are the only ones that it may use, `nice` (0 to 19) lowers its priority. SIGINT ends it
    even if this program ignores SIGINT, as background jobs of a shell do: `stop` relies on that.
    It runs in a session of its own: Ctrl-C in the terminal reaches this program only, which then
    stops the others in order. When this program is killed, the kernel interrupts them.
    """
    libc, parent = ctypes.CDLL(None), os.getpid()

    def prepare_child():
        # kept through exec, also of the shell scripts that start nodes
        libc.prctl(PR_SET_PDEATHSIG, signal.SIGINT)
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        if cores:
            os.sched_setaffinity(0, cores)
        if nice:
            os.nice(nice)
            with contextlib.suppress(OSError):  # kernels that share time among sessions
                AUTOGROUP.write_text(str(nice))
        if os.getppid() != parent:  # killed before prctl took effect
            os.kill(os.getpid(), signal.SIGKILL)

    with log.open('wb') as output:
        popen = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**environment, 'PYTHONUNBUFFERED': '1'},
            start_new_session=True,
            preexec_fn=prepare_child,
        )
    return Process(name, popen, log)


def stop(processes: Sequence[Process], patience_s: float = INTERRUPT_S) -> None:
    """End programs: SIGINT to all, wait `patience_s` in total, then SIGKILL to the rest."""
    for process in processes:
        if process.code is None:
            process.popen.send_signal(signal.SIGINT)
    deadline = time.monotonic() + patience_s
    for process in processes:
        try:
            process.popen.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            kill(process)


def kill(process: Process) -> None:
    """End a program and everything that it started, at once."""
    if process.code is None:
        # session and process group are its own
        os.killpg(process.popen.pid, signal.SIGKILL)
    process.popen.wait()


def check_running(processes: Sequence[Process]) -> None:
    """Raise ProcessError when one of the programs has ended."""
    for process in processes:
        if process.code is not None:
            raise ProcessError(exit_report(process))


def exit_report(process: Process) -> str:
    """Return how a program ended, with the last lines of its log."""
    tail = process.log.read_text(errors='replace').splitlines()[-TAIL_LINES:]
    lines = ''.join(f'\n  | {line}' for line in tail)
    output = f':{lines}' if lines else ' without any output'
    return f'{process.name} ended early {describe_exit(process.code)}{output}'


def describe_exit(code: int) -> str:
    """Return an exit code in words; a negative one is that of a signal."""
    return f'with exit code {code}' if code >= 0 else f'by {signal.Signals(-code).name}'


def last_line(log: Path) -> str:
    """Return the last complete line of a log, '' without one; reads the end of the file only.

    Lines that follow the report of a blocked shutdown do not count.
    """
    with log.open('rb') as file:
        file.seek(0, os.SEEK_END)
        file.seek(max(0, file.tell() - TAIL_BYTES))
        text = file.read().decode(errors='replace')
    before, traceback_start, _ = text.partition(f'\n{shutdown.TRACEBACK_START}')
    # the text after the last line feed is still being written
    *lines, _ = (before + traceback_start).split('\n')
    return next((line for line in reversed(lines) if line.strip()), '')


def node_environment(domain: int, logs: Path) -> dict[str, str]:
    """Return the environment of nodes in a ROS domain, reachable from this machine only.

    The user's ROS_AUTOMATIC_DISCOVERY_RANGE overrides the latter.
    """
    return {
        **DEFAULT_ENVIRONMENT,
        **os.environ,
        **FIXED_ENVIRONMENT,
        'ROS_DOMAIN_ID': str(domain),
        'ROS_LOG_DIR': str(logs),
        'RCUTILS_COLORIZED_OUTPUT': '0',
    }


def start_node(
    node: Node,
    folder: Path,
    environment: Mapping[str, str],
    *,
    name: str = '',
    log: str = '',
    program: Sequence[str] = (),
    extra_arguments: Sequence[str] = (),
    cores: set[int] | None = None,
    nice: int = 0,
) -> Process:
    """Start a node; its parameter file and its log go to `folder`.

    The process is called `name` (default: the role), the log file `log` (default: <name>.log).
    `program` replaces the installed executable, `extra_arguments` follow the ROS arguments; `cores`
    and `nice` as in `start`.
    """
    parameter_file = node_config.write_parameter_file(node, folder)
    command = [*(program or share.node_command(node.package, node.executable))]
    command += [*node_config.ros_arguments(node, parameter_file), *extra_arguments]
    name = name or node.role
    return start(name, command, folder / (log or f'{name}.log'), environment, cores, nice)


class Interrupted(KeyboardInterrupt):
    """A signal requested the end of this program.

    number  of the signal
    kept    path of the recording that was kept, None without one
    """

    def __init__(self, number: int, *message: str):
        super().__init__(*message)
        self.number = number
        self.kept: Path | None = None

    @property
    def exit_code(self) -> int:
        """Exit code that shells report for the signal: 130 for SIGINT, 143 for SIGTERM."""
        return SHELL_SIGNAL + self.number


class Interrupt:
    """A context in which a signal only sets a flag, which `sleep` and `check` read.

    An ignored SIGHUP stays ignored, as under nohup. SIGINT and SIGTERM always count: shells make
    background programs ignore SIGINT, but a SIGINT sent to one is intended.
    """

    def __init__(self):
        self._number: int | None = None  # of the first signal
        self._before = {}

    def __enter__(self):
        keeps_hangup_ignored = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
        caught = [n for n in SIGNALS if n != signal.SIGHUP or not keeps_hangup_ignored]
        self._before = {number: signal.signal(number, self._set_flag) for number in caught}
        return self

    def __exit__(self, *error):
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _set_flag(self, number, frame):
        self._number = self._number or number

    def check(self) -> None:
        """Raise Interrupted when a signal has come."""
        if self._number is not None:
            raise Interrupted(self._number)

    def sleep(self) -> None:
        """Wait POLL_S, then check."""
        time.sleep(POLL_S)
        self.check()
