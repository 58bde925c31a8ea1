"""Tasks on a cluster end as in processes of this machine, and workers that differ are refused."""

import importlib
import math
import multiprocessing
import os
import signal
import sys
from multiprocessing import spawn

import pytest
from dask_cluster import Cluster

from bags.errors import BagError
from experiments import cluster_pool
from experiments.cluster_pool import ClusterPool, open_pool
from experiments.worker_pool import WorkerPool

EXITS, WAITS = "__import__('os')._exit(3)", "__import__('signal').pause()"
KILLS_ITS_DASK_WORKER_ONCE = """
import os, pathlib, signal, sys
if not pathlib.Path(path).exists():
    pathlib.Path(path).touch()
    os.kill(os.getppid(), signal.SIGKILL)
    signal.pause()
"""


def same():
    return {'version': '1'}


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


def test_without_an_address_the_pool_is_of_this_machine():
    with open_pool(1, '', same) as pool:
        assert isinstance(pool, WorkerPool)


def test_an_address_where_nothing_listens_is_an_error(monkeypatch):
    monkeypatch.setattr('experiments.cluster_pool.CONNECT_S', 0.2)
    with pytest.raises(BagError, match='no scheduler answers'):
        ClusterPool('tcp://127.0.0.1:9', same).__enter__()


def test_without_the_library_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, 'distributed', None)
    with pytest.raises(BagError, match=r'pip install "experiments\[cluster\]"'):
        ClusterPool('tcp://127.0.0.1:9', same).__enter__()


@pytest.mark.slow
def test_a_task_that_raises_ends_its_process_or_takes_too_long_fails_alone(kept):
    tasks = [('1 / 0',), (EXITS,), ('2**3',)]
    with ClusterPool(kept.address, same) as pool:
        ended = {one.number: one for one in pool.finish_each(eval, tasks)}
        # one that has a limit is given to a process that has imported what it needs: how long that
        # takes depends on what else the machine does
        waiting = {one.number: one for one in pool.finish_each(eval, [('2**3',), (WAITS,)], (), 8)}
        assert pool.run(eval, [('1',), ('2',)], int) == [1, 2]
    assert ended[2].value == waiting[0].value == 8
    assert str(ended[0].error) == 'division by zero'
    assert str(ended[1].error) == 'its process ended with exit code 3'
    assert str(waiting[1].error) == 'its process was ended after 8 s'


@pytest.mark.slow
def test_tasks_that_are_sent_together_end_each_by_itself(kept, monkeypatch):
    monkeypatch.setattr('experiments.cluster_pool.THREADS', 0.25)
    tasks = [(text,) for text in ('0', '1', EXITS, '1 / 0', *map(str, range(4, 19)))]
    with ClusterPool(kept.address, same) as pool:
        assert pool._bundle(100) == 4
        assert pool._bundle(3) == 1
        ended = {one.number: one for one in pool.finish_each(eval, tasks)}
    assert sorted(ended) == list(range(19))
    assert {number for number, one in ended.items() if one.error} == {2, 3}
    assert all(one.value == number for number, one in ended.items() if not one.error)


@pytest.mark.slow
def test_tasks_of_a_worker_that_ends_are_done_by_the_others(cluster, tmp_path):
    cluster.start_worker()
    cluster.start_worker()
    task = (KILLS_ITS_DASK_WORKER_ONCE, {'path': str(tmp_path / 'done')})
    with ClusterPool(cluster.address, same) as pool:
        (ended,) = pool.finish_each(exec, [task])
    assert ended.error is None
    assert sorted(worker.poll() is None for worker in cluster.workers) == [False, True]


@pytest.mark.slow
def test_without_a_worker_the_error_says_how_to_start_one(cluster):
    with pytest.raises(BagError, match=r'no worker in 0.2 s; start some: dask worker tcp://.*'):
        ClusterPool(cluster.address, same, workers_s=0.2).__enter__()


@pytest.mark.slow
def test_every_command_has_new_processes(kept):
    asked = [("__import__('os').getpid()",)] * 2
    seen = []
    for _ in range(2):
        with ClusterPool(kept.address, same) as pool:
            seen.append({finished.value for finished in pool.finish_each(eval, asked)})
    assert [len(pids) for pids in seen] == [1, 1]
    assert seen[0] != seen[1]


def answer(command, describe):
    return cluster_pool._answer(command, describe, describe(), eval, [('1',)], math.inf)


def test_a_process_that_cannot_start_refuses_its_tasks():
    executable = spawn.get_executable()
    spawn.set_executable('/bin/false')
    try:
        refusal = answer('no process', same)
    finally:
        spawn.set_executable(executable)
    assert 'cannot start processes: its process ended with exit code 1' in refusal.reason
    assert answer('no process', same) == [(1, None)]


def loaded():
    return {'sources': 'old' if multiprocessing.parent_process() is None else 'new'}


def test_a_process_that_has_loaded_other_sources_refuses_its_tasks():
    refusal = answer('other sources', loaded)
    assert "sources is 'new', 'old' where the command runs" in refusal.reason


def process():
    return {'process': str(os.getpid())}


@pytest.mark.slow
def test_a_worker_with_other_versions_is_refused(kept):
    here = os.getpid()
    with pytest.raises(BagError, match=rf"process is '\d+', '{here}' where the command runs"):
        ClusterPool(kept.address, process).__enter__()


@pytest.mark.slow
def test_a_worker_that_cannot_start_processes_is_refused(cluster):
    cluster.start_worker('--nanny')
    with pytest.raises(BagError, match='a nanny started it; start it without'):
        ClusterPool(cluster.address, same).__enter__()


@pytest.mark.slow
def test_a_scheduler_that_ends_is_an_error(cluster):
    cluster.start_worker()
    with ClusterPool(cluster.address, same) as pool:
        ended = pool.finish_each(eval, [('1',), (WAITS,)])
        assert next(ended).value == 1
        cluster.scheduler.send_signal(signal.SIGKILL)
        with pytest.raises(BagError, match='the scheduler is gone; what has ended is kept'):
            next(ended)


@pytest.mark.slow
def test_a_worker_without_the_modules_of_the_command_is_refused(kept, tmp_path, monkeypatch):
    (tmp_path / 'only_here.py').write_text('def describe():\n    return {}\n')
    monkeypatch.syspath_prepend(tmp_path)
    describe = importlib.import_module('only_here').describe
    with pytest.raises(BagError, match=r"'only_here'.*; is this project installed"):
        ClusterPool(kept.address, describe).__enter__()
