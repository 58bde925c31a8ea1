"""A pool of processes that do tasks: of this machine, or of a dask.distributed cluster.

Threads of this program, or of dask workers, hand out the tasks. Each has them done in a process of
its own, one after the other: a task that ends its process, or takes longer than allowed, fails
alone. The tasks of a dask worker that ends are done again by others.
"""

import contextlib
import logging
import math
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
import traceback
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent import futures
from multiprocessing import connection
from multiprocessing.pool import RemoteTraceback
from typing import Any, NamedTuple

from bags.errors import BagError

LEAVE_S = 5.0  # for the tasks in progress when the pool is left
CONNECT_S = 10.0
WORKERS_S = 60.0  # without any worker
POLL_S = 1.0  # between two looks whether scheduler and workers are there
PER_THREAD = 2  # tasks that have been sent: the next one is there when one ends

Describe = Callable[[], Mapping[str, str]]


class WorkerError(BagError):
    """A task has no result; the message says what became of its process."""


class RefusedError(Exception):
    """A process that must not do a task; the text says why."""


class Finished(NamedTuple):
    """A task that has ended: with a value, or with the error that it raised or ended by."""

    number: int  # of the task, from 0
    value: Any
    error: Exception | None = None


class Pool:
    """A context with `jobs` processes of this machine, or with the workers of a scheduler.

    What dies costs one row, which the next call drives again (`row_runner`).

    address   of the scheduler, as `tcp://10.0.0.1:8786`; '' for this machine
    describe  called here and in every process of a cluster: {name: version} of what decides
              results; a process in which it differs is refused
    console   on which its `progress` is shown, a CountProgress; without one there is none

    Entering it raises BagError for a scheduler without dask.distributed, or that does not answer.
    """

    def __init__(
        self, jobs: int, address: str = '', describe: Describe = dict, console: Any = None
    ):
        # imported late: the processes show nothing
        if console:
            from experiments.progress import CountProgress
        self.progress = CountProgress(console) if console else None
        self._threads, self._address = jobs, address
        self._command = uuid.uuid4().hex
        # without a scheduler the processes are of this program
        wanted = (describe, dict(describe())) if address else (dict, {})
        self._check = pickle.dumps((refuse_others, wanted))

    def __enter__(self):
        with contextlib.ExitStack() as stack:
            if self.progress:
                stack.enter_context(self.progress)
            if self._address:
                self._executor = self._connect(stack)
            else:
                self._executor = futures.ThreadPoolExecutor(self._threads)
                stack.callback(_end_processes, self._command)
                stack.callback(self._executor.shutdown, wait=False, cancel_futures=True)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error):
        self._stack.close()

    def _connect(self, stack):
        try:
            from distributed import Client
        except ModuleNotFoundError:
            raise BagError(
                f'--dask {self._address}: needs dask.distributed: pip install distributed'
            ) from None
        for name in ('distributed', 'distributed.client'):
            # errors are one line each, those raised here
            logger = logging.getLogger(name)
            stack.callback(logger.setLevel, logger.level)
            logger.setLevel(logging.CRITICAL)
        try:
            self._client = Client(self._address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            reason = ' '.join(str(error).split())
            raise BagError(f'--dask {self._address}: no scheduler answers: {reason}') from None
        self._seen_s = time.monotonic()  # when a worker was there
        stack.callback(self._disconnect)
        return self._client.get_executor(pure=False)

    def _disconnect(self):
        def leave():
            with contextlib.suppress(Exception):  # scheduler or workers may be gone
                self._client.run(_end_processes, self._command, on_error='ignore')

        # in a thread: one that does not answer must not hold up Ctrl-C
        leaving = threading.Thread(target=leave, daemon=True)
        leaving.start()
        leaving.join(LEAVE_S + POLL_S)
        with contextlib.suppress(Exception):  # the scheduler may be gone
            self._client.close(timeout=POLL_S)

    def finish_each(
        self, function: Callable, tasks: Sequence[tuple], limit_s: float = math.inf
    ) -> Iterator[Finished]:
        """Yield function(*task) of every task as it ends, whether it has a value or an error.

        `limit_s` is the wall time after which a task fails. Raises BagError when the scheduler is
        gone, when no worker is there for WORKERS_S, and for a process that is refused.
        """
        waiting = deque(enumerate(tasks))
        sent: dict[futures.Future, int] = {}  # numbers of the tasks
        looked_s = -math.inf
        try:
            while waiting or sent:
                if self._address and time.monotonic() - looked_s > POLL_S:
                    self._look()
                    looked_s = time.monotonic()
                while waiting and len(sent) < max(1, PER_THREAD * self._threads):
                    number, task = waiting.popleft()
                    sent[self._submit(pickle.dumps((function, task)), limit_s)] = number
                for future in futures.wait(sent, POLL_S, futures.FIRST_COMPLETED).done:
                    yield Finished(sent.pop(future), *self._answer(future))
        finally:
            for future in sent:
                future.cancel()

    def run(self, function: Callable, tasks: Iterable[tuple]) -> list[Any]:
        """Return function(*task) for every task, in their order.

        Raises the exception of the first task that fails.
        """
        values = {}
        for finished in self.finish_each(function, list(tasks)):
            if finished.error:
                raise finished.error
            values[finished.number] = finished.value
        return [values[number] for number in sorted(values)]

    def _submit(self, task, limit_s):
        try:
            return self._executor.submit(_do, self._command, self._check, task, limit_s)
        except (OSError, RuntimeError, ValueError):
            if not self._address or self._client.status == 'running':
                raise
            raise self._gone() from None

    def _answer(self, future):
        """Return value and error of a task."""
        try:
            value, error, trace = pickle.loads(future.result())
        except futures.CancelledError:
            raise self._gone() from None
        except Exception as failed:  # of reading the task, or of dask, which may not be installed
            is_killed = type(failed).__name__ == 'KilledWorker'
            return None, WorkerError('every dask worker that did it ended') if is_killed else failed
        if isinstance(error, RefusedError):
            raise BagError(f'--dask {self._address}: a worker: {error}' if self._address else error)
        if trace:
            error.__cause__ = RemoteTraceback(f'\n{trace}')
        return value, error

    def _look(self):
        """Raise BagError when the scheduler is gone, or no worker was there for WORKERS_S."""
        try:
            self._threads = sum(self._client.nthreads().values())
        except OSError:
            raise self._gone() from None
        if self._client.status != 'running':
            raise self._gone()
        if self._threads:
            self._seen_s = time.monotonic()
        elif time.monotonic() - self._seen_s > WORKERS_S:
            raise BagError(
                f'--dask {self._address}: no worker in {WORKERS_S:g} s; start some: '
                f'dask worker {self._address} --nthreads CORES'
            )

    def _gone(self):
        return BagError(
            f'--dask {self._address}: the scheduler is gone; what has ended is kept, the same '
            'command goes on with another one'
        )


class TaskProcess:
    """A process that does one task after the other, and ends with the one that started it."""

    def __init__(self):
        # not that of the caller: a script that drives needs no `if __name__ == '__main__'`
        code = f'import sys; sys.path[:] = {sys.path!r}; from experiments import pool; pool.work()'
        self._popen = subprocess.Popen(
            [sys.executable, '-c', code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            # a core each; numpy reads this when it is imported
            env={**os.environ, 'OPENBLAS_NUM_THREADS': '1'},
            start_new_session=True,  # Ctrl-C is for the program, which then ends its processes
        )

    @property
    def is_idle(self) -> bool:
        """Whether it waits for a task. One that has ended does not, nor one with an answer."""
        pipe = self._popen.stdout
        return self._popen.returncode is None and not connection.wait([pipe], 0.0)

    def begin(self, task: bytes) -> None:
        """Begin a task, a pickled function with its arguments. Raises OSError when it has ended."""
        pickle.dump(task, self._popen.stdin)
        self._popen.stdin.flush()

    def do(self, task: bytes, limit_s: float = math.inf) -> bytes:
        """Return value, error and traceback of a task, pickled."""
        try:
            self.begin(task)
            if connection.wait([self._popen.stdout], None if math.isinf(limit_s) else limit_s):
                return pickle.load(self._popen.stdout)
            self.end()
            error = f'its process was ended after {limit_s:g} s'
        except (EOFError, OSError, ValueError, pickle.UnpicklingError):
            error = self.end(LEAVE_S)
        return pickle.dumps((None, WorkerError(error), ''))

    def terminate(self) -> None:
        """Send SIGTERM to it and all that it has started, and let it end within LEAVE_S."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._popen.pid, signal.SIGTERM)
        self.end(LEAVE_S)

    def leave(self) -> None:
        """Let the process end after its task, within LEAVE_S."""
        with contextlib.suppress(OSError, ValueError):
            self._popen.stdin.close()

    def end(self, wait_s: float = 0.0) -> str:
        """Let the process end within `wait_s`, or end it; return how it ended, for a person."""
        self.leave()
        if self._popen.returncode is None:
            # until it is waited for, its number belongs to nobody else
            with contextlib.suppress(OSError):  # another thread ended it, or it cannot be watched
                descriptor = os.pidfd_open(self._popen.pid)
                try:
                    connection.wait([descriptor], wait_s)
                finally:
                    os.close(descriptor)
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._popen.pid, signal.SIGKILL)  # its compilers, too, also of a crash
        code = self._popen.wait()
        self._popen.stdout.close()
        if code >= 0:
            return f'its process ended with exit code {code}'
        hint = ' (out of memory?)' if -code == signal.SIGKILL else ''
        return f'its process was ended by {signal.Signals(-code).name}{hint}'


class _Processes:
    """Those that this program has started for one command."""

    def __init__(self):
        self.started: list[TaskProcess] = []
        self.idle: list[TaskProcess] = []
        self.has_left = False  # whether the command has


# by command. A new command has new ones: others remember files as they were for the last one
_processes: dict[str, _Processes] = {}


def _do(command, check, task, limit_s):
    """Do a task in a process of a command; return the answer, pickled."""
    own = _processes.setdefault(command, _Processes())
    try:
        process = _idle(own) or (None if own.has_left else _start(own, check))
    except (OSError, RefusedError) as error:
        return pickle.dumps((None, RefusedError(str(error)), ''))
    if own.has_left:
        if process:
            process.end()
        return pickle.dumps((None, WorkerError('the pool was left'), ''))
    answer = process.do(task, limit_s)
    own.idle.append(process)
    return answer


def _idle(own):
    """Return a process that waits for a task, None without one; those that have ended are left."""
    while True:
        try:
            process = own.idle.pop()  # of several threads one gets it
        except IndexError:
            return None
        if process.is_idle:
            return process
        process.end()


def _start(own, check):
    """Return a process that may do the tasks of a command. Raises OSError and RefusedError."""
    process = TaskProcess()
    own.started.append(process)
    _, error, _ = pickle.loads(process.do(check))
    if error:
        process.end()
        hint = '; is this project installed?' if isinstance(error, ImportError) else ''
        known = isinstance(error, RefusedError)
        raise error if known else RefusedError(f'cannot start a process: {error}{hint}')
    return process


def _end_processes(command):
    """End those that this program has started for a command."""
    own = _processes.setdefault(command, _Processes())
    own.has_left = True
    for process in own.started:
        process.leave()
    end = time.monotonic() + LEAVE_S
    for process in own.started:
        process.end(max(0.0, end - time.monotonic()))
    own.started.clear()
    own.idle.clear()


def work() -> None:
    """Do what comes in on stdin until that is closed; what a task prints goes to stderr."""
    answers = os.fdopen(os.dup(1), 'wb')
    os.dup2(2, 1)
    tasks: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
    threading.Thread(target=_read_tasks, args=(tasks,), daemon=True).start()
    while (task := tasks.get()) is not None:
        pickle.dump(_answer(task), answers)
        answers.flush()


def _read_tasks(tasks):
    with contextlib.suppress(EOFError):
        while True:
            tasks.put(pickle.load(sys.stdin.buffer))
    tasks.put(None)
    time.sleep(LEAVE_S)
    os._exit(1)


def refuse_others(describe: Describe, wanted: Mapping[str, str]) -> None:
    """Raise RefusedError where what decides results, by name, differs from what is wanted."""
    own = dict(describe())
    differ = [
        f'{name} is {own.get(name)!r}, {wanted.get(name)!r} where the command runs'
        for name in dict.fromkeys([*wanted, *own])
        if own.get(name) != wanted.get(name)
    ]
    if differ:
        raise RefusedError(f'its results would differ: {"; ".join(differ)}')


def _answer(task):
    """Return value, error and traceback of a task, pickled so that they can be read."""
    try:
        function, arguments = pickle.loads(task)
        return pickle.dumps((function(*arguments), None, ''))
    except Exception as error:
        trace = traceback.format_exc()
        try:
            answer = pickle.dumps((None, error, trace))
            pickle.loads(answer)
            return answer
        except Exception:
            return pickle.dumps((None, RuntimeError(f'{type(error).__name__}: {error}'), trace))
