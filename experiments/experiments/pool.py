"""A pool of processes that do tasks: of this machine, or of a dask.distributed cluster.

Dask hands out the tasks. Each thread of a dask worker does its tasks in a process of its own, one
after the other: a task that ends its process, or takes longer than allowed, fails alone. On this
machine the dask worker is a part of the program, with a thread per process. The tasks of a dask
worker of a cluster that ends are done again by others.
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
from multiprocessing import connection
from typing import Any, NamedTuple

from bags.errors import BagError

LEAVE_S = 5.0  # for the tasks in progress when the pool is left
CONNECT_S = 10.0
WORKERS_S = 60.0  # without any worker
POLL_S = 1.0  # between two looks whether scheduler and workers are there
PER_THREAD = 2  # tasks that have been sent: the next one is there when one ends
NO_LIBRARY = 'several processes need dask.distributed: pip install distributed'
LOGGERS = ('', '.client', '.core', '.batched', '.comm', '.worker', '.scheduler')

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

    Entering it raises BagError without dask.distributed, or without a scheduler.
    """

    def __init__(self, jobs: int, address: str = '', describe: Describe = dict):
        self.jobs, self.address = jobs, address
        self._command = uuid.uuid4().hex
        # without a scheduler the processes are of this program
        wanted = (describe, dict(describe())) if address else (dict, {})
        self._check = pickle.dumps((refuse_others, wanted))
        self._stack = contextlib.ExitStack()
        self._threads = 0
        self._seen_s = time.monotonic()  # when a worker was there

    def __enter__(self):
        try:
            from distributed import Client, LocalCluster
        except ModuleNotFoundError:
            raise BagError(NO_LIBRARY) from None
        with contextlib.ExitStack() as stack:
            stack.enter_context(_quiet())  # errors are one line each, those raised here
            if self.address:
                scheduler = self.address
            else:
                scheduler = stack.enter_context(
                    LocalCluster(
                        n_workers=1,
                        threads_per_worker=self.jobs,
                        processes=False,
                        memory_limit=0,
                        dashboard_address=None,
                        scheduler_kwargs={'dashboard_address': '127.0.0.1:0'},
                    )
                )
                for server in (scheduler.scheduler, *scheduler.workers.values()):
                    # nobody looks at their pages
                    scheduler.loop.add_callback(server.http_server.stop)
            try:
                self._client = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
            except (OSError, ValueError) as error:
                reason = ' '.join(str(error).split())
                raise BagError(f'--dask {self.address}: no scheduler answers: {reason}') from None
            stack.callback(self._leave)
            self._stack = stack.pop_all()
        self._seen_s = time.monotonic()
        return self

    def __exit__(self, *error):
        self._stack.close()

    def _leave(self):
        if self.address:  # in a thread: one that does not answer must not hold up Ctrl-C
            telling = threading.Thread(target=self._end_far_processes, daemon=True)
            telling.start()
            telling.join(LEAVE_S + POLL_S)
        _end_processes(self._command)
        with contextlib.suppress(Exception):  # the scheduler may be gone
            self._client.close(timeout=POLL_S)

    def _end_far_processes(self):
        with contextlib.suppress(Exception):  # scheduler or workers may be gone
            self._client.run(_end_processes, self._command, on_error='ignore')

    def finish_each(
        self, function: Callable, tasks: Sequence[tuple], limit_s: float = math.inf
    ) -> Iterator[Finished]:
        """Yield function(*task) of every task as it ends, whether it has a value or an error.

        `limit_s` is the wall time after which a task fails. Raises BagError when the scheduler is
        gone, when no worker is there for WORKERS_S, and for a process that is refused.
        """
        self._look()
        waiting = deque(enumerate(tasks))
        sent: dict[int, Any] = {}  # futures of the answers
        ended: queue.SimpleQueue[int] = queue.SimpleQueue()
        looked_s = time.monotonic()

        def notify(number):
            sent[number].add_done_callback(lambda _: ended.put(number))

        try:
            while waiting or sent:
                while waiting and len(sent) < max(1, PER_THREAD * self._threads):
                    number, task = waiting.popleft()
                    sent[number] = self._submit(pickle.dumps((function, task)), limit_s)
                    notify(number)
                with contextlib.suppress(queue.Empty):
                    number = ended.get(timeout=POLL_S)
                    try:
                        pair = self._answer(sent[number])
                    except TimeoutError:  # its worker ended before it answered
                        notify(number)
                    else:
                        del sent[number]
                        yield Finished(number, *pair)
                if time.monotonic() - looked_s > POLL_S:
                    self._look()
                    looked_s = time.monotonic()
        finally:
            if sent and self._client.status == 'running':
                with contextlib.suppress(Exception):
                    self._client.cancel(list(sent.values()))

    def run(
        self,
        function: Callable,
        tasks: Iterable[tuple],
        on_done: Callable[[], object] = lambda: None,
    ) -> list[Any]:
        """Return function(*task) for every task, in their order; call `on_done()` after each.

        Raises the exception of the first task that fails.
        """
        tasks = list(tasks)
        values: list[Any] = [None] * len(tasks)
        for finished in self.finish_each(function, tasks):
            if finished.error:
                raise finished.error
            values[finished.number] = finished.value
            on_done()
        return values

    def _submit(self, task, limit_s):
        try:
            return self._client.submit(_do, self._command, self._check, task, limit_s, pure=False)
        except (OSError, RuntimeError, ValueError):
            if self._client.status == 'running':
                raise
            raise self._gone() from None

    def _answer(self, future):
        """Return value and error of a task. Raises TimeoutError where its answer was lost."""
        from distributed import CancelledError
        from distributed.scheduler import KilledWorker

        if future.status == 'cancelled':
            raise self._gone()
        try:
            value, error, trace = pickle.loads(future.result(timeout=CONNECT_S))
        except KilledWorker:
            return None, WorkerError('every dask worker that did it ended')
        except CancelledError:
            raise self._gone() from None
        except TimeoutError:
            self._look()
            raise
        except Exception as failed:  # of reading the task or its answer
            return None, failed
        if isinstance(error, RefusedError):
            raise BagError(f'--dask {self.address}: a worker: {error}' if self.address else error)
        if trace:
            error.__cause__ = _RemoteError(trace)
        return value, error

    def _look(self):
        """Raise BagError when the scheduler is gone, or no worker was there for WORKERS_S."""
        try:
            self._threads = sum(self._client.nthreads().values())
        except OSError:
            raise self._gone() from None
        if self._client.status != 'running':
            raise self._gone()
        now = time.monotonic()
        self._seen_s = now if self._threads else self._seen_s
        if now - self._seen_s > WORKERS_S:
            raise BagError(
                f'--dask {self.address}: no worker in {WORKERS_S:g} s; start some: '
                f'dask worker {self.address} --nthreads CORES'
            )

    def _gone(self):
        return BagError(
            f'--dask {self.address}: the scheduler is gone; what has ended is kept, the same '
            'command goes on with another one'
        )


class _RemoteError(Exception):
    """The traceback of an error in another process, shown as its cause."""

    def __str__(self):
        return f'\n{self.args[0]}'


@contextlib.contextmanager
def _quiet():
    loggers = [logging.getLogger(f'distributed{name}') for name in LOGGERS]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels):
            logger.setLevel(level)


class TaskProcess:
    """A process that does one task after the other, and ends with the one that started it."""

    def __init__(self, check: bytes = b''):
        """Start it, and do a first task, whose error is that of the process.

        Raises RefusedError when it cannot start, or must not do tasks of this program.
        """
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
        _, error, _ = pickle.loads(self.do(check)) if check else (None, None, '')
        if error:
            self.end(0.0)
            hint = '; is this project installed?' if isinstance(error, ImportError) else ''
            known = isinstance(error, RefusedError)
            raise error if known else RefusedError(f'cannot start a process: {error}{hint}')

    @property
    def is_alive(self) -> bool:
        """Whether it has not ended."""
        how = os.WEXITED | os.WNOHANG | os.WNOWAIT  # its number stays its own until `end`
        with contextlib.suppress(ChildProcessError):  # another thread ends it
            return self._popen.returncode is None and not os.waitid(os.P_PID, self._popen.pid, how)
        return False

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
            self.end(0.0)
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

    def end(self, wait_s: float) -> str:
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
        if code >= 0:
            return f'its process ended with exit code {code}'
        hint = ' (out of memory?)' if -code == signal.SIGKILL else ''
        return f'its process was ended by {signal.Signals(-code).name}{hint}'


_own = threading.local()  # command and process of a thread of a dask worker
_processes: dict[str, list[TaskProcess]] = {}  # by command, those of this program
_left: set[str] = set()  # commands


def _do(command, check, task, limit_s):
    """Do a task in the process of this thread of a dask worker; return the answer, pickled."""
    if command in _left:
        return pickle.dumps((None, WorkerError('the pool was left'), ''))
    if getattr(_own, 'command', None) != command or not _own.process.is_alive:
        # a new one for each command: another remembers files as they were for the last command
        if hasattr(_own, 'process'):
            _own.process.end(LEAVE_S)
            _processes.get(_own.command, [_own.process]).remove(_own.process)
            del _own.process, _own.command
        try:
            _own.process, _own.command = TaskProcess(check), command
        except (OSError, RefusedError) as error:
            return pickle.dumps((None, RefusedError(str(error)), ''))
        _processes.setdefault(command, []).append(_own.process)
        if command in _left:  # meanwhile
            _end_processes(command)
            return pickle.dumps((None, WorkerError('the pool was left'), ''))
    return _own.process.do(task, limit_s)


def _end_processes(command):
    """End those that this program has started for a command."""
    _left.add(command)
    leaving = _processes.pop(command, [])
    for process in leaving:
        process.leave()
    end = time.monotonic() + LEAVE_S
    for process in leaving:
        process.end(max(0.0, end - time.monotonic()))


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
