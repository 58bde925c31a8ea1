"""A pool of processes that share work over the cores and end with this program, however it ends.

A task that ends its process, or takes longer than allowed, fails alone: the process is replaced.
`cluster_pool` is the same for the processes of many machines; TaskPool is what both are.
"""

import math
import os
import pickle
import signal
import sys
import threading
import time
import traceback
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import connection, get_context, parent_process
from types import ModuleType
from typing import Any, NamedTuple

from bags.errors import BagError

LEAVE_S = 5.0  # for the tasks in progress when the pool is left


class WorkerError(BagError):
    """A task has no result; the message says what became of its process."""


class Finished(NamedTuple):
    """A task that has ended: with a value, or with the error that it raised or ended by."""

    number: int  # of the task, from 0
    value: Any
    error: Exception | None = None


class TaskPool(ABC):
    """A context in which tasks are done by other processes."""

    def __enter__(self):
        return self

    @abstractmethod
    def __exit__(self, *error): ...

    def finish_each(
        self,
        function: Callable,
        tasks: Sequence[tuple],
        groups: Sequence[Hashable] = (),
        limit_s: float = math.inf,
    ) -> Iterator[Finished]:
        """Yield function(*task) of every task as it ends, whether it has a value or an error.

        groups   one per task: tasks of a group should meet in a process, so that what it prepared
                 for the first serves the others
        limit_s  wall time after which a task fails
        """
        return self._finish_each(function, tasks, groups, limit_s)

    @abstractmethod
    def _finish_each(self, function, tasks, groups, limit_s) -> Iterator[Finished]:
        """Yield as `finish_each`; `groups` is empty or has a group per task."""

    def run(
        self, function: Callable, tasks: Iterable[tuple], on_done: Callable[[], None]
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


class WorkerPool(TaskPool):
    """A context with `jobs` processes, started when there is work for them.

    Leaving it cancels the tasks that have not begun, gives the others LEAVE_S, and ends them.
    """

    def __init__(self, jobs: int):
        self.jobs = jobs
        self._workers: list[_Worker] = []
        self._dismissed: list[_Worker] = []

    def __exit__(self, *error):
        leaving = self._workers + self._dismissed
        for worker in leaving:
            worker.pipe.close()
        end = time.monotonic() + LEAVE_S
        for worker in leaving:
            worker.end(max(0.0, end - time.monotonic()))
        self._workers, self._dismissed = [], []

    def _finish_each(self, function, tasks, groups, limit_s):
        """Give each process tasks of its group while there are any."""
        queue = _Queue(groups or [None] * len(tasks))
        try:
            while queue.waiting or self._busy():
                self._hand_out(queue, function, tasks, limit_s)
                yield from self._collect()
        finally:
            # their answers belong to no later call
            for worker in self._busy():
                worker.pipe.close()
                self._workers.remove(worker)
                self._dismissed.append(worker)

    def _busy(self):
        return [worker for worker in self._workers if worker.task is not None]

    def _hand_out(self, queue, function, tasks, limit_s):
        wanted = min(self.jobs, len(self._busy()) + queue.count)
        while len(self._workers) < wanted:
            self._workers.append(_Worker())
        for worker in [worker for worker in self._workers if worker.is_idle]:
            if not queue.waiting:
                return
            elsewhere = {other.group for other in self._busy()}
            number, group = queue.take(worker.group, elsewhere)
            try:
                worker.begin(number, group, pickle.dumps((function, tasks[number])), limit_s)
            except OSError:  # it was ended while it had nothing to do
                queue.put_back(number, group)
                self._end(worker, LEAVE_S)

    def _collect(self):
        """Yield what has ended, after waiting for the next message or the next time limit."""
        by_pipe = {worker.pipe: worker for worker in self._workers if not worker.is_idle}
        if not by_pipe:  # all have ended without work
            return
        next_limit_s = min((worker.limit for worker in by_pipe.values()), default=math.inf)
        rest_s = max(0.0, next_limit_s - time.monotonic())
        for pipe in connection.wait(by_pipe, None if math.isinf(rest_s) else rest_s):
            worker = by_pipe[pipe]
            try:
                finished = worker.receive()
            except (EOFError, OSError):
                finished = self._end(worker, LEAVE_S)
            if finished:
                yield finished
        for worker in self._busy():
            if time.monotonic() >= worker.limit:
                self._end(worker, 0.0)
                error = WorkerError(f'its process was ended after {worker.limit_s:g} s')
                yield Finished(worker.task, None, error)

    def _end(self, worker, wait_s):
        """Take a process out of the pool and return what its task comes to, None without one.

        `_hand_out` starts another when there is work. Raises WorkerError for a process that could
        not start: the next one could not either.
        """
        self._workers.remove(worker)
        error = WorkerError(worker.end(wait_s))
        if not worker.has_started:
            raise error
        return None if worker.task is None else Finished(worker.task, None, error)


class _Queue:
    """The numbers of the tasks that have not begun, by group, in their order."""

    def __init__(self, groups):
        self.waiting: dict[Hashable, deque[int]] = {}
        self.count = len(groups)
        for number, group in enumerate(groups):
            self.waiting.setdefault(group, deque()).append(number)

    def take(self, group, elsewhere):
        """Return the next task and its group: this one, else one that no other process has."""
        if group not in self.waiting:
            free = (other for other in self.waiting if other not in elsewhere)
            group = next(free, next(iter(self.waiting)))
        number = self.waiting[group].popleft()
        if not self.waiting[group]:
            del self.waiting[group]
        self.count -= 1
        return number, group

    def put_back(self, number, group):
        self.waiting.setdefault(group, deque()).appendleft(number)
        self.count += 1


class _Worker:
    """A process, and what it is doing."""

    def __init__(self):
        # spawned: a fork would copy the threads of the progress display
        context = get_context('spawn')
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_work, args=(theirs,), daemon=True)
        with main_left_out():
            self.process.start()
        theirs.close()
        self.has_started = False
        self.task: int | None = None
        self.group: Hashable = None
        self.limit = self.limit_s = math.inf  # by time.monotonic(); s after the beginning

    @property
    def is_idle(self):
        return self.has_started and self.task is None

    def begin(self, task, group, message, limit_s):
        """Begin a task. Raises OSError when the process has ended."""
        self.pipe.send_bytes(message)
        self.task, self.group = task, group
        self.limit, self.limit_s = time.monotonic() + limit_s, limit_s

    def receive(self):
        """Return the Finished task, None when the process says that it has started.

        Raises EOFError or OSError when it has ended.
        """
        answer = self.pipe.recv()
        if not self.has_started:
            self.has_started = True
            return None
        value, error, trace = answer
        if error is not None:
            error.__cause__ = _RemoteError(trace)
        number, self.task, self.limit = self.task, None, math.inf
        return Finished(number, value, error)

    def end(self, wait_s):
        """Let the process end within `wait_s`, or end it; return how it ended, for a person."""
        self.pipe.close()
        self.process.join(wait_s)
        if self.process.exitcode is None:
            self.process.kill()
            self.process.join()
        code = self.process.exitcode
        if code >= 0:
            return f'its process ended with exit code {code}'
        hint = ' (out of memory?)' if -code == signal.SIGKILL else ''
        return f'its process was ended by {signal.Signals(-code).name}{hint}'


@contextmanager
def main_left_out() -> Iterator[None]:
    """Start a process that does not run the caller's script again.

    Tasks are functions of modules, which import what they need. A script or a notebook that calls
    `drive_many` needs no `if __name__ == '__main__'` then.
    """
    main = sys.modules['__main__']
    sys.modules['__main__'] = ModuleType('__main__')
    try:
        yield
    finally:
        sys.modules['__main__'] = main


class _RemoteError(Exception):
    """The traceback of an error in another process, shown as its cause."""

    def __str__(self):
        return f'\n{self.args[0]}'


def _work(pipe):
    """Do what is asked until the pipe is closed."""
    # Ctrl-C is for the parent, which then ends its workers
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # a core each; numpy reads this when it is imported, so nothing here may import it
    os.environ['OPENBLAS_NUM_THREADS'] = '1'
    exit_with_parent()
    try:
        pipe.send('started')
        while True:
            pipe.send_bytes(_answer(pipe.recv_bytes()))
    except (EOFError, OSError):
        return


def _answer(message):
    """Return value, error and traceback of a task, pickled."""
    try:
        function, arguments = pickle.loads(message)
        return pickle.dumps((function(*arguments), None, ''))
    except Exception as error:
        trace = traceback.format_exc()
        try:
            answer = pickle.dumps((None, error, trace))
            pickle.loads(answer)
            return answer
        except Exception:
            return pickle.dumps((None, RuntimeError(f'{type(error).__name__}: {error}'), trace))


def exit_with_parent() -> None:
    """Let this process end with the one that started it, however that ends."""
    threading.Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent():
    # PR_SET_PDEATHSIG would not do: it is sent at the end of the parent's thread, too, and never
    # when the parent ended before the call
    parent_process().join()
    os._exit(1)
