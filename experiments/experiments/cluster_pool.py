"""A pool of the workers of a dask.distributed cluster: `worker_pool.TaskPool` over many machines.

Each thread of a dask worker keeps one process for a command (a WorkerPool of one), in which its
tasks are done: a task that crashes or takes too long fails alone, as on this machine, and the dask
worker stays. The tasks of a dask worker that ends are done again by others.
"""

import contextlib
import logging
import math
import queue
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from multiprocessing import current_process
from typing import Any, NamedTuple

from bags.errors import BagError
from experiments.worker_pool import Finished, TaskPool, WorkerError, WorkerPool

CONNECT_S = 10.0
WORKERS_S = 60.0  # without any worker
POLL_S = 1.0  # between two looks whether scheduler and workers are there
PER_THREAD = 2  # bundles that have been sent: the next one is there when one ends
# a scheduler hands out some 400 bundles a second: with more threads than this, a bundle has several
# tasks, which are done again together when their dask worker ends
THREADS = 32
NO_LIBRARY = (
    '--dask needs dask.distributed, which is not installed: pip install "experiments[cluster]", '
    'or pip install distributed'
)
START = 'dask worker ADDRESS --nthreads CORES --no-nanny'

Describe = Callable[[], Mapping[str, str]]


class Refusal(NamedTuple):
    """What a worker returns that must not do a task, and why."""

    reason: str


class _Bundle(NamedTuple):
    """Tasks that were sent together."""

    numbers: Sequence[int]
    future: Any  # of their answers

    def fail(self, error):
        return [Finished(number, None, error) for number in self.numbers]


class ClusterPool(TaskPool):
    """A context with the workers of the scheduler at an address, as `tcp://10.0.0.1:8786`.

    describe   called here and by every worker: {name: version} of what decides results; a worker at
               which it differs is refused
    workers_s  wall time after which to be without a worker is an error

    Entering it raises BagError without dask.distributed, without a scheduler, and for a worker that
    is refused.
    """

    def __init__(self, address: str, describe: Describe, workers_s: float = WORKERS_S):
        self.address, self.describe, self.workers_s = address, describe, workers_s
        self.wanted = dict(describe())
        self._command = uuid.uuid4().hex
        self._threads = 0
        self._alone_s = 0.0  # since when there has been no worker

    def __enter__(self):
        try:
            from distributed import Client
        except ModuleNotFoundError:
            raise BagError(NO_LIBRARY) from None
        # errors are one line each, those raised below
        self._loggers = {name: logging.getLogger(name).level for name in LOGGERS}
        for name in LOGGERS:
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            self._client = Client(self.address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            self._restore_loggers()
            reason = ' '.join(str(error).split())
            raise BagError(f'--dask {self.address}: no scheduler answers: {reason}') from None
        try:
            self._wait_for_worker()
            self._check_workers()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *error):
        with contextlib.suppress(Exception):  # the scheduler may be gone
            self._client.close(timeout=POLL_S)
        self._restore_loggers()

    def _restore_loggers(self):
        for name, level in self._loggers.items():
            logging.getLogger(name).setLevel(level)

    def _wait_for_worker(self):
        try:
            self._client.wait_for_workers(1, timeout=self.workers_s)
        except TimeoutError:
            raise self._no_worker() from None
        self._count_threads()

    def _no_worker(self):
        return BagError(
            f'--dask {self.address}: no worker in {self.workers_s:g} s; start some: '
            f'{START.replace("ADDRESS", self.address)}'
        )

    def _check_workers(self):
        """Refuse workers whose versions differ before they have a task."""
        answers = self._client.run(_refusal, self.describe, self.wanted, on_error='return')
        for worker, answer in answers.items():
            if isinstance(answer, Exception):
                answer = Refusal(f'{type(answer).__name__}: {answer}; is this project installed?')
            if answer is not None:
                raise self._refused(worker, answer)

    def _refused(self, worker, refusal):
        return BagError(f'--dask {self.address}: worker {worker}: {refusal.reason}')

    def _count_threads(self):
        """Count the threads of the workers; raise BagError when none has been there for long."""
        self._threads = sum(self._client.nthreads().values())
        if self._threads:
            self._alone_s = 0.0
        elif not self._alone_s:
            self._alone_s = time.monotonic()
        elif time.monotonic() - self._alone_s > self.workers_s:
            raise self._no_worker()

    def _finish_each(self, function, tasks, groups, limit_s):
        """Send tasks to the workers and yield them as they end.

        Tasks are sent in the order of their groups. Raises BagError when the scheduler is gone,
        when no worker is there for `workers_s`, and for a worker that is refused.
        """
        order = _by_group(groups) if groups else range(len(tasks))
        waiting = deque(order)
        sent: dict[int, _Bundle] = {}  # by the number of its first task
        done: queue.SimpleQueue[int] = queue.SimpleQueue()
        looked_s = time.monotonic()
        try:
            while True:
                while waiting and len(sent) < max(1, PER_THREAD * self._threads):
                    numbers = [waiting.popleft() for _ in range(self._bundle(len(waiting)))]
                    future = self._submit(function, [tasks[n] for n in numbers], limit_s)
                    sent[numbers[0]] = _Bundle(numbers, future)
                    _notify(future, done, numbers[0])
                if not sent:
                    return
                with contextlib.suppress(queue.Empty):
                    first = done.get(timeout=POLL_S)
                    ended = self._collect(sent[first])
                    if ended is None:  # its worker ended before it answered
                        _notify(sent[first].future, done, first)
                    else:
                        del sent[first]
                        yield from ended
                if time.monotonic() - looked_s > POLL_S:
                    self._look()
                    looked_s = time.monotonic()
        finally:
            if sent and self._client.status == 'running':
                with contextlib.suppress(Exception):
                    self._client.cancel([bundle.future for bundle in sent.values()])

    def _bundle(self, waiting):
        """Return how many tasks the next bundle has; fewer where threads would wait at the end."""
        threads = max(1, self._threads)
        return max(1, min(math.ceil(threads / THREADS), waiting // (PER_THREAD * threads)))

    def _submit(self, function, tasks, limit_s):
        arguments = (self._command, self.describe, self.wanted, function, tasks, limit_s)
        try:
            return self._client.submit(_answer, *arguments, pure=False)
        except (OSError, RuntimeError, ValueError):
            if self._client.status == 'running':
                raise
            raise self._gone() from None

    def _look(self):
        """Raise BagError when the scheduler is gone or no worker is there."""
        if self._client.status != 'running':
            raise self._gone()
        try:
            self._count_threads()
        except OSError:
            raise self._gone() from None

    def _gone(self):
        return BagError(
            f'--dask {self.address}: the scheduler is gone; what has ended is kept, the same '
            'command goes on with another one'
        )

    def _collect(self, bundle):
        """Return the Finished tasks of a bundle that is done, None when its answer is lost."""
        from distributed import CancelledError
        from distributed.scheduler import KilledWorker

        if bundle.future.status == 'cancelled':
            raise self._gone()
        try:
            answer = bundle.future.result(timeout=CONNECT_S)
        except KilledWorker:
            return bundle.fail(WorkerError('every dask worker that did it ended'))
        except CancelledError:
            raise self._gone() from None
        except TimeoutError:
            self._look()
            return None
        except Exception as error:  # of reading the task or its answer
            return bundle.fail(error)
        if isinstance(answer, Refusal):
            raise self._refused('of a task', answer)
        return [Finished(number, *pair) for number, pair in zip(bundle.numbers, answer)]


def open_pool(jobs: int, address: str, describe: Describe) -> TaskPool:
    """Return a pool of processes of this machine, or of the cluster at an address unless ''."""
    return ClusterPool(address, describe) if address else WorkerPool(jobs)


LOGGERS = ('distributed.client', 'distributed.core', 'distributed.batched', 'distributed.comm')


def _by_group(groups):
    first = {group: place for place, group in reversed(list(enumerate(groups)))}
    return sorted(range(len(groups)), key=lambda number: first[groups[number]])


def _notify(future, done, number):
    future.add_done_callback(lambda _: done.put(number))


def _refusal(describe, wanted):
    """Return why this dask worker must not do a task, None when nothing differs."""
    if refusal := _difference(describe, wanted):
        return refusal
    if current_process().daemon:
        return Refusal(
            f'cannot start processes, because a nanny started it; start it without: {START}'
        )
    return None


def _difference(describe, wanted):
    own = dict(describe())
    differ = [
        f'{name} is {own.get(name)!r}, {wanted.get(name)!r} where the command runs'
        for name in dict.fromkeys([*wanted, *own])
        if own.get(name) != wanted.get(name)
    ]
    if differ:
        return Refusal(f'its results would differ: {"; ".join(differ)}')
    return None


_thread_state = threading.local()


def _answer(command, describe, wanted, function, tasks, limit_s):
    """Return value and error of each task, or a Refusal, in a thread of a dask worker."""
    if refusal := _refusal(describe, wanted):
        return refusal
    if getattr(_thread_state, 'command', None) != command:
        # a new process: another one remembers files as they were for the last command
        if hasattr(_thread_state, 'pool'):
            _thread_state.pool.__exit__()
        _thread_state.command = command
        _thread_state.pool = WorkerPool(1)  # its process ends with this one
    checked = [(describe, wanted, function, task) for task in tasks]
    try:
        # one process does them in their order
        ended = list(_thread_state.pool.finish_each(_do_checked, checked, limit_s=limit_s))
    except (OSError, WorkerError) as error:
        return Refusal(f'cannot start processes: {error}')
    refusals = (finished.value for finished in ended if isinstance(finished.value, Refusal))
    return next(refusals, [(finished.value, finished.error) for finished in ended])


def _do_checked(describe, wanted, function, task):
    """Return function(*task), or a Refusal, in the process of a thread.

    What this process has loaded may be newer than what the dask worker described.
    """
    return _difference(describe, wanted) or function(*task)
