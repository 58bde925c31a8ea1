"""Tasks end alike here and on a cluster, leave no process; workers that differ are refused."""

import importlib
import json
import os
import signal
import subprocess
import sys

import pytest
from wait_until import lives, wait_until

from bags.errors import BagError
from experiments.pool import Pool

TIMEOUT_S = 60.0
# a process that starts another, as a drive starts a compiler, says so and never ends
STARTS_ANOTHER = """
import os, pathlib, signal, subprocess, sys
other = subprocess.Popen([sys.executable, '-c', 'import signal; signal.pause()'])
pathlib.Path({file!r}).write_text(f'{{os.getpid()}} {{other.pid}}.')
{then}
"""
ASKS = 'from experiments.pool import Pool\nwith Pool(1, {address!r}) as pool:\n{body}'
EXITS, WAITS = "__import__('os')._exit(3)", "__import__('signal').pause()"
OWN_KILL = "__import__('os').kill(__import__('os').getpid(), 9)"
ASKING = """
import os, time
from experiments.pool import Pool
with Pool(1) as pool:
    print(*pool.run(os.getpid, [()]), flush=True)
    pool.run(time.sleep, [(1000,)])
"""
KILLS_ITS_DASK_WORKER_ONCE = """
import os, pathlib, signal, sys
if not pathlib.Path(path).exists():
    pathlib.Path(path).touch()
    os.kill(os.getppid(), signal.SIGKILL)
    signal.pause()
"""


def same():
    return {'version': '1'}


def process():
    return {'process': str(os.getpid())}


class Cluster:
    """A dask.distributed scheduler at `address`, and the workers that are started; a context."""

    def __init__(self, folder):
        folder.mkdir()
        self.folder, self.workers = folder, []

    def __enter__(self):
        facts = self.folder / 'scheduler.json'
        self.scheduler = self._start('scheduler', '--port', '0', '--scheduler-file', facts)

        def is_there():
            return facts.exists() and facts.read_text().endswith('}')

        wait_until(is_there, 2 * TIMEOUT_S, self._log('scheduler').read_text)
        self.address = json.loads(facts.read_text())['address']
        return self

    def __exit__(self, *error):
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()

    def start_worker(self, nanny: str = '--no-nanny') -> subprocess.Popen:
        """Start a worker with a thread."""
        own = ('--nthreads', '1', '--local-directory', self.folder)
        self.workers.append(self._start('worker', self.address, *own, nanny))
        return self.workers[-1]

    def _start(self, what, *options):
        command = [sys.executable, '-m', f'distributed.cli.dask_{what}', *map(str, options)]
        with self._log(what).open('a') as log:
            return subprocess.Popen(
                [*command, '--host', '127.0.0.1', '--no-dashboard'],
                stdout=log,
                stderr=log,
                env=os.environ | {'PYTHONPATH': ':'.join(filter(None, sys.path))},
            )

    def _log(self, what):
        return self.folder / f'{what}.log'


@pytest.fixture
def cluster(tmp_path):
    with Cluster(tmp_path / 'cluster') as one:
        yield one


@pytest.fixture(scope='module')
def kept(tmp_path_factory):
    """Return a cluster with a worker, for tests that end neither of them."""
    with Cluster(tmp_path_factory.mktemp('kept') / 'cluster') as one:
        one.start_worker()
        yield one


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGINT])
def test_a_process_ends_with_the_program_that_started_it(number):
    parent = subprocess.Popen(
        [sys.executable, '-c', ASKING],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    worker = int(parent.stdout.readline())
    assert lives(worker)
    parent.send_signal(number)
    parent.wait(TIMEOUT_S)
    parent.stdout.close()
    wait_until(lambda: not lives(worker), TIMEOUT_S, 'the process outlives its program')


@pytest.mark.parametrize('where', ['here', pytest.param('cluster', marks=pytest.mark.slow)])
def test_a_task_that_raises_ends_its_process_or_takes_too_long_fails_alone(request, where):
    address = request.getfixturevalue('kept').address if where == 'cluster' else ''
    with Pool(1, address, same) as pool:
        (before,) = set(pool.run(os.getpid, [()] * 2))
    with Pool(1, address, same) as pool:
        # every command has new processes
        assert pool.run(os.getpid, [()]) != [before]
        # a limit is for a process that has imported what it needs: how long that takes depends on
        # what else the machine does
        ended = [*pool.finish_each(eval, [('2**3',), ('1 / 0',), (EXITS,), (OWN_KILL,)])]
        ended += pool.finish_each(eval, [('2**3',), (WAITS,)], 8.0)
    assert sorted((str(one.error or ''), one.value) for one in ended) == [
        ('', 8),
        ('', 8),
        ('division by zero', None),
        ('its process ended with exit code 3', None),
        ('its process was ended after 8 s', None),
        ('its process was ended by SIGKILL (out of memory?)', None),
    ]


def test_after_an_error_or_the_end_of_a_process_a_pool_goes_on():
    with Pool(2) as pool:
        with pytest.raises(ZeroDivisionError) as caught:
            pool.run(eval, [('1 / 0',), ("__import__('time').sleep(0.2)",)])
        # it shows where in the process it was raised
        assert 'line 1, in <module>' in str(caught.value.__cause__)
        assert pool.run(eval, [('1',), ('2',), ('3',)]) == [1, 2, 3]
    with Pool(1) as pool:
        (first,) = pool.run(os.getpid, [()])
        os.kill(first, signal.SIGKILL)
        wait_until(lambda: not lives(first), TIMEOUT_S, 'a killed process lives')
        assert pool.run(os.getpid, [()]) != [first]


def test_a_pool_that_cannot_begin_says_why(monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(sys, 'executable', '/bin/false')
        with Pool(1) as pool, pytest.raises(BagError, match=r'cannot start .* exit code 1'):
            pool.run(eval, [('1',)])
    # no scheduler: test_run_batch.py
    monkeypatch.setitem(sys.modules, 'distributed', None)
    with pytest.raises(BagError, match='pip install distributed'):
        Pool(1, 'tcp://127.0.0.1:9', same).__enter__()


@pytest.mark.slow
def test_tasks_of_a_worker_that_ends_are_done_by_the_others(cluster, tmp_path):
    for _ in range(2):
        cluster.start_worker('--nanny')  # as `dask worker` does
    task = (KILLS_ITS_DASK_WORKER_ONCE, {'path': str(tmp_path / 'done')})
    with Pool(1, cluster.address, same) as pool:
        (ended,) = pool.finish_each(exec, [task])
    assert ended.error is None


@pytest.mark.slow
def test_a_cluster_without_workers_or_scheduler_is_an_error(cluster, monkeypatch):
    with monkeypatch.context() as patched, Pool(1, cluster.address, same) as pool:
        patched.setattr('experiments.pool.WORKERS_S', 0.2)
        with pytest.raises(BagError, match=r'no worker in 0.2 s; start some: dask worker tcp://.*'):
            pool.run(eval, [('1',)])
    cluster.start_worker()
    with Pool(1, cluster.address, same) as pool:
        ended = pool.finish_each(eval, [('1',), (WAITS,)])
        assert next(ended).value == 1
        cluster.scheduler.send_signal(signal.SIGKILL)
        with pytest.raises(BagError, match='the scheduler is gone; what has ended is kept'):
            next(ended)


@pytest.mark.slow
def test_a_worker_with_other_versions_or_without_the_modules_is_refused(
    kept, tmp_path, monkeypatch
):
    here = os.getpid()
    (tmp_path / 'only_here.py').write_text('def describe():\n    return {}\n')
    monkeypatch.syspath_prepend(tmp_path)
    describe = importlib.import_module('only_here').describe
    messages = {process: f"', '{here}' where the command", describe: 'is this project installed'}
    for wanted, message in messages.items():
        with Pool(1, kept.address, wanted) as pool, pytest.raises(BagError, match=message):
            pool.run(eval, [('1',)])


def started(file):
    """Return the processes of a task, when both are there."""
    wait_until(lambda: file.exists() and file.read_text().endswith('.'), TIMEOUT_S, 'no task began')
    return [int(word) for word in file.read_text().rstrip('.').split()]


def ask(file, then, address=''):
    """Start a program that gives the task to a pool."""
    body = f'    pool.run(exec, [({STARTS_ANOTHER.format(file=str(file), then=then)!r},)])'
    script = ASKS.format(address=address, body=body)
    return subprocess.Popen(
        [sys.executable, '-c', script], stderr=subprocess.DEVNULL, start_new_session=True
    )


def wait_for_the_end_of(pids):
    wait_until(lambda: not any(map(lives, pids)), TIMEOUT_S, f'of {pids} one was left behind')


def test_what_a_crashed_task_has_started_ends_with_it(tmp_path):
    with ask(tmp_path / 'pids', 'os._exit(3)') as program:
        wait_for_the_end_of(started(tmp_path / 'pids'))
        assert program.wait(TIMEOUT_S) == 1


@pytest.mark.slow
def test_a_task_on_a_cluster_ends_with_the_command_that_gave_it(tmp_path):
    with Cluster(tmp_path / 'cluster') as cluster:
        worker = cluster.start_worker()
        with ask(tmp_path / 'pids', 'signal.pause()', cluster.address) as program:
            pids = started(tmp_path / 'pids')
            os.kill(program.pid, signal.SIGINT)
            program.wait(TIMEOUT_S)
            wait_for_the_end_of(pids)
        assert worker.poll() is None
