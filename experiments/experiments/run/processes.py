"""Start programs, watch over them, stop them: each with its own log file and session, by pid."""

import contextlib
import ctypes
import os
import signal
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from node_runtime import leaving

INTERRUPT_S = 12.0  # to end after SIGINT: last words take 5 s at most, leaving 4
PR_SET_PDEATHSIG = 1  # linux/prctl.h
AUTOGROUP = Path('/proc/self/autogroup')
TAIL_LINES = 15
TAIL_BYTES = 2000


class ProcessError(RuntimeError):
    """A program ended when it should not have; the message shows its last lines."""


class Process(NamedTuple):
    """One running program and where it writes."""

    name: str
    popen: subprocess.Popen
    log: Path

    @property
    def code(self):
        """Exit code, None while it runs, negative for a signal."""
        return self.popen.poll()


def start(
    name: str,
    command: Sequence[str],
    log: Path,
    environment: Mapping[str, str],
    cores: set[int] | None = None,
    nice: int = 0,
) -> Process:
    """Start a program; its output goes to `log`, unbuffered, `cores` are the only ones it may use.

    `nice` is how far it stands back behind others (0 to 19).

    SIGINT ends it, even if this program was started with SIGINT ignored, as a shell does for
    background jobs: `stop` relies on that. It runs in a session of its own: Ctrl-C in the terminal
    reaches this program only, which then stops the others in order. Should this program be killed,
    the kernel interrupts them.
    """
    libc, parent = ctypes.CDLL(None), os.getpid()

    def tie():
        # stays through exec, so through the shell scripts that nodes are started by, too
        libc.prctl(PR_SET_PDEATHSIG, signal.SIGINT)
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        if cores:
            os.sched_setaffinity(0, cores)
        if nice:
            os.nice(nice)
            with contextlib.suppress(OSError):  # kernels that share time among sessions
                AUTOGROUP.write_text(str(nice))
        if os.getppid() != parent:  # killed before that
            os.kill(os.getpid(), signal.SIGKILL)

    with log.open('wb') as output:
        popen = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**environment, 'PYTHONUNBUFFERED': '1'},
            start_new_session=True,
            preexec_fn=tie,
        )
    return Process(name, popen, log)


def stop(processes: Sequence[Process], patience_s: float = INTERRUPT_S) -> None:
    """End programs: SIGINT to all, `patience_s` of time together, then SIGKILL to the rest."""
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
    """End a program and whatever it started, at once."""
    if process.code is None:
        # the session is its own, so is the group
        os.killpg(process.popen.pid, signal.SIGKILL)
    process.popen.wait()


def check(processes: Sequence[Process]) -> None:
    """Raise ProcessError when one of the programs has ended."""
    for process in processes:
        if process.code is not None:
            raise ProcessError(obituary(process))


def obituary(process: Process) -> str:
    """Return how a program ended and the last lines it wrote."""
    lines = process.log.read_text(errors='replace').splitlines()[-TAIL_LINES:]
    said = ''.join(f'\n  | {line}' for line in lines)
    words = f':{said}' if said else ' without a word'
    return f'{process.name} ended early {how_it_ended(process.code)}{words}'


def how_it_ended(code: int) -> str:
    """Return an exit code in words; a negative one is that of a signal."""
    return f'with exit code {code}' if code >= 0 else f'by {signal.Signals(-code).name}'


def last_line(log: Path) -> str:
    """Return the last whole line of a log, '' without one; reads its end only.

    Of a node that was held when it left, what it said before counts.
    """
    with log.open('rb') as file:
        file.seek(0, os.SEEK_END)
        file.seek(max(0, file.tell() - TAIL_BYTES))
        text = file.read().decode(errors='replace').partition(f'\n{leaving.HELD}')
    # what follows the last line feed is still being written
    lines = (text[0] + text[1]).split('\n')[:-1]
    return next((line for line in reversed(lines) if line.strip()), '')
