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

LONG_S = 30.0


class Solver:
    """A solver that is never asked to solve."""


@pytest.fixture
def pool(monkeypatch):
    """Return a function that makes the solves of a process on some cores."""

    def bound_to(cores, most=3):
        monkeypatch.setattr(os, 'sched_getaffinity', lambda _: set(range(cores)))
        return ParallelSolves(Solver, most)

    return bound_to


def fail(*_):
    raise RuntimeError(threading.current_thread().name)


def patient():
    return LONG_S


def impatient():
    return 0.01


@pytest.mark.parametrize('most', [1, 3, 7])
@pytest.mark.parametrize('cores', [1, 2, 4, 16])
def test_all_problems_are_solved_at_once_where_there_are_cores(pool, most, cores):
    """Every thread waits until all are at work: with a thread less nobody would get on."""
    solves, at_once = pool(cores, most), min(most + 1, cores)
    assert len(solves.solvers) == at_once
    everybody, used = threading.Barrier(at_once, timeout=LONG_S), []

    def job(solver):
        used.append(solver)
        if len(used) < at_once:  # the first one of each thread
            everybody.wait()
        return solver

    _, results = solves.run(everybody.wait, [job] * most)
    assert len(results) == most
    assert all(results)
    assert not everybody.broken


def test_a_process_that_is_bound_to_a_core_later_solves_in_one_thread(pool, monkeypatch):
    solves, threads = pool(4), []
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: {2})
    solves.run(lambda: None, [lambda solver: threads.append(threading.get_ident())] * 3)
    assert set(threads) == {threading.get_ident()}


def test_results_are_in_the_order_of_the_jobs_and_errors_reach_the_caller(pool):
    solves = pool(4, 5)
    jobs = [lambda solver, number=number: number for number in range(5)]
    assert solves.run(lambda: 'own', jobs) == ('own', [0, 1, 2, 3, 4])
    with pytest.raises(RuntimeError):
        solves.run(lambda: None, [fail] * 5)
    with pytest.raises(RuntimeError, match='candidates'):  # of another thread
        pool(1, 1).run(lambda: None, [fail], patient)


def test_an_error_of_the_caller_stops_what_was_not_begun(pool):
    solves, solved = pool(1), []
    with pytest.raises(RuntimeError):
        solves.run(fail, [solved.append] * 3, patient)
    solves.run(lambda: None, [lambda solver: None], patient)
    assert solved == []


@pytest.mark.parametrize(('priority', 'lower'), [(20, 19), (1, 1)])
def test_a_thread_has_a_lower_real_time_priority_than_its_maker(pool, monkeypatch, priority, lower):
    solves, changes = pool(1, 1), []
    monkeypatch.setattr(os, 'sched_getscheduler', lambda _: os.SCHED_FIFO)
    monkeypatch.setattr(os, 'sched_getparam', lambda _: os.sched_param(priority))
    monkeypatch.setattr(os, 'sched_setscheduler', lambda *change: changes.append(change))
    solves.run(lambda: None, [lambda solver: None], patient)
    assert changes == [(0, os.SCHED_FIFO, os.sched_param(lower))]


class Hanging:
    """A job that hangs in every thread until it is released; counts how often it was begun."""

    def __init__(self):
        self.begun, self.release, self.count = threading.Event(), threading.Event(), 0

    def __call__(self, solver):
        self.count += 1
        self.begun.set()
        self.release.wait(LONG_S)
        return solver


@pytest.fixture
def hanging():
    job = Hanging()
    yield job
    job.release.set()


def hang(solves, hanging, many=3):
    """Run jobs that hang until one of them was begun: a busy machine may not begin in time."""

    def run():
        own, results = solves.run(threading.get_ident, [hanging] * many, impatient)
        assert (own, results) == (threading.get_ident(), [None] * many)
        return hanging.begun.is_set()

    wait_until(run, LONG_S, 'no job was begun')


@pytest.mark.parametrize('cores', [1, 2, 4])
def test_the_caller_waits_as_long_as_it_may_whoever_hangs(pool, hanging, cores):
    """The fewer cores there are, the sooner a job would be the caller's own."""
    solves, began = pool(cores), time.monotonic()

    def all_hang():
        hang(solves, hanging)
        return solves.idle == []

    wait_until(all_hang, LONG_S, 'some solver took no job')
    hang(solves, hanging)
    assert time.monotonic() - began < 0.7 * LONG_S


def test_a_job_that_was_not_begun_in_time_is_not_begun_later(pool, hanging):
    solves = pool(1)
    hang(solves, hanging)
    hanging.release.set()
    wait_until(lambda: solves.idle, LONG_S, 'the job did not return')
    assert hanging.count == 1
    _, results = solves.run(lambda: None, [hanging] * 2, patient)
    assert results == [solves.solvers[0]] * 2


def test_a_solver_that_hangs_is_not_used_until_it_returns(pool, hanging):
    solves = pool(2)
    _, results = solves.run(lambda: hanging.begun.wait(LONG_S), [hanging], impatient)
    assert results == [None]
    assert solves.idle == solves.solvers[:1]
    for _ in range(3):
        _, results = solves.run(lambda: None, [lambda solver: solver], patient)
        assert results == solves.solvers[:1]
    hanging.release.set()
    wait_until(lambda: len(solves.idle) == 2, LONG_S, 'the job did not return')


def test_the_threads_end_with_the_solvers(pool):
    def running():
        return {thread for thread in threading.enumerate() if thread.name == 'candidates'}

    before, solves = running(), pool(1, 1)
    solves.run(lambda: None, [lambda solver: None], patient)
    started = running() - before
    assert started
    del solves
    gc.collect()
    wait_until(lambda: not started & running(), LONG_S, 'a thread did not end')


def test_a_solver_that_hangs_does_not_hold_the_end_of_the_process():
    text = """
import threading
from mpcc_controller.driving.parallel_solves import ParallelSolves

begun = threading.Event()
hang = lambda solver: (begun.set(), threading.Event().wait())
solves = ParallelSolves(object, 1)
while not begun.is_set():
    assert solves.run(lambda: None, [hang], lambda: 0.01)[1] == [None]
print('at its end')
"""
    ended = subprocess.run([sys.executable, '-c', text], capture_output=True, timeout=60, text=True)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, 'at its end\n', '')
