"""Which thread solves what: as many at once as there are problems and cores."""

import gc
import os
import subprocess
import sys
import threading
import time

import pytest
from wait_until import wait_until

from mpcc_controller.driving.parallel_solves import ParallelSolves


class Solver:
    """A solver that is never asked to solve."""


@pytest.mark.parametrize('most', [1, 3, 7])
@pytest.mark.parametrize('cores', [1, 2, 4, 16])
def test_all_problems_are_solved_at_once_where_there_are_cores(monkeypatch, most, cores):
    """Every thread waits until all are at work: with a thread less nobody would get on."""
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: set(range(cores)))
    pool = ParallelSolves(Solver, most)
    at_once = min(most + 1, cores)
    assert len(pool.solvers) == at_once
    everybody, used = threading.Barrier(at_once, timeout=30.0), []

    def job(solver):
        used.append(solver)
        if len(used) < at_once:  # the first one of each thread
            everybody.wait()
        return solver

    _, results = pool.run(everybody.wait, [job] * most)
    assert len(results) == most
    assert all(results)
    assert not everybody.broken


def test_a_process_that_is_bound_to_a_core_later_solves_in_one_thread(monkeypatch):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: set(range(4)))
    pool = ParallelSolves(Solver, 3)
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: {2})
    threads = []
    pool.run(lambda: None, [lambda solver: threads.append(threading.get_ident())] * 3)
    assert set(threads) == {threading.get_ident()}


def test_results_are_in_the_order_of_the_jobs_and_errors_reach_the_caller():
    pool = ParallelSolves(Solver, 5)
    jobs = [lambda solver, number=number: number for number in range(5)]
    assert pool.run(lambda: 'own', jobs) == ('own', [0, 1, 2, 3, 4])

    def fail(solver):
        raise RuntimeError('broken')

    with pytest.raises(RuntimeError, match='broken'):
        pool.run(lambda: None, [fail] * 5)


def test_an_error_of_another_thread_reaches_the_caller(monkeypatch):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: {0})

    def fail(solver):
        raise RuntimeError(threading.current_thread().name)

    with pytest.raises(RuntimeError, match='candidates'):
        ParallelSolves(Solver, 1).run(lambda: None, [fail], lambda: 30.0)


@pytest.mark.parametrize(('priority', 'lower'), [(20, 19), (1, 1)])
def test_a_thread_has_a_lower_real_time_priority_than_its_maker(monkeypatch, priority, lower):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: {0})
    monkeypatch.setattr(os, 'sched_getscheduler', lambda _: os.SCHED_FIFO)
    monkeypatch.setattr(os, 'sched_getparam', lambda _: os.sched_param(priority))
    changes = []
    monkeypatch.setattr(os, 'sched_setscheduler', lambda *change: changes.append(change))
    ParallelSolves(Solver, 1).run(lambda: None, [lambda solver: None], lambda: 30.0)
    assert changes == [(0, os.SCHED_FIFO, os.sched_param(lower))]


class Hanging:
    """A job that hangs in every thread until it is released; counts how often it was begun."""

    def __init__(self):
        self.begun, self.release, self.count = threading.Event(), threading.Event(), 0

    def __call__(self, solver):
        self.count += 1
        self.begun.set()
        self.release.wait(30.0)
        return solver


@pytest.fixture
def hanging():
    job = Hanging()
    yield job
    job.release.set()


@pytest.mark.parametrize('cores', [1, 2, 4])
def test_the_caller_waits_as_long_as_it_may_whoever_hangs(monkeypatch, hanging, cores):
    """The fewer cores there are, the sooner a job would be the caller's own."""
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: set(range(cores)))
    pool, began = ParallelSolves(Solver, 3), time.monotonic()
    for _ in range(2):  # then every solver hangs already
        own, results = pool.run(threading.get_ident, [hanging] * 3, lambda: 0.01)
        assert (own, results) == (threading.get_ident(), [None] * 3)
        assert hanging.begun.wait(30.0)
    assert time.monotonic() - began < 20.0  # far from the 30 s of a job
    assert pool.idle == []


def test_a_job_that_was_not_begun_in_time_is_not_begun_later(monkeypatch, hanging):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: {0})
    pool = ParallelSolves(Solver, 3)
    pool.run(lambda: None, [hanging] * 3, lambda: 0.01)
    assert hanging.begun.wait(30.0)
    hanging.release.set()
    wait_until(lambda: pool.idle, 30.0, 'the job did not return')
    assert hanging.count == 1
    _, results = pool.run(lambda: None, [hanging] * 2, lambda: 30.0)
    assert results == [pool.solvers[0]] * 2


def test_a_solver_that_hangs_is_not_used_until_it_returns(monkeypatch, hanging):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: {0, 1})
    pool = ParallelSolves(Solver, 3)
    _, results = pool.run(lambda: hanging.begun.wait(30.0), [hanging], lambda: 0.01)
    assert results == [None]
    assert pool.idle == pool.solvers[:1]
    for _ in range(3):
        _, results = pool.run(lambda: None, [lambda solver: solver], lambda: 30.0)
        assert results == pool.solvers[:1]
    hanging.release.set()
    wait_until(lambda: len(pool.idle) == 2, 30.0, 'the job did not return')


def test_an_error_of_the_caller_stops_what_was_not_begun(monkeypatch):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: {0})
    pool, solved = ParallelSolves(Solver, 3), []

    def fail():
        raise RuntimeError('broken')

    with pytest.raises(RuntimeError, match='broken'):
        pool.run(fail, [solved.append] * 3, lambda: 30.0)
    pool.run(lambda: None, [lambda solver: None], lambda: 30.0)
    assert solved == []


def test_a_solver_that_hangs_does_not_hold_the_end_of_the_process():
    text = """
import threading
from mpcc_controller.driving import parallel_solves

class Solver:
    pass

pool = parallel_solves.ParallelSolves(Solver, 1)
begun = threading.Event()
_, results = pool.run(
    lambda: None, [lambda solver: (begun.set(), threading.Event().wait())], lambda: 0.01
)
assert results == [None] and begun.wait(60.0)
print('at its end')
"""
    ended = subprocess.run([sys.executable, '-c', text], capture_output=True, timeout=60, text=True)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, 'at its end\n', '')


@pytest.mark.needs('priority')
def test_with_real_time_priority_on_one_core_the_caller_gets_on_beside_a_solver_that_hangs():
    text = """
import hashlib
import os
import time
from mpcc_controller.driving import parallel_solves

class Solver:
    pass

def busy(solver):  # without Python's lock, as a solver in C
    hashlib.pbkdf2_hmac('sha256', b'', b'', 10_000_000)

os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
pool, began = parallel_solves.ParallelSolves(Solver, 1), time.monotonic()
_, results = pool.run(lambda: None, [busy], lambda: 0.01)
print(results, time.monotonic() - began < 1.0, flush=True)
os._exit(0)
"""
    ended = subprocess.run([sys.executable, '-c', text], capture_output=True, timeout=90, text=True)
    assert (ended.stdout, ended.stderr) == ('[None] True\n', '')


def test_the_threads_end_with_the_solvers():
    def count():
        return sum(thread.name == 'candidates' for thread in threading.enumerate())

    gc.collect()
    before, pool = count(), ParallelSolves(Solver, 1)
    pool.run(lambda: None, [lambda solver: None], lambda: 30.0)
    assert count() > before
    del pool
    gc.collect()
    wait_until(lambda: count() <= before, 30.0, 'a thread did not end')
