"""Which thread solves what: as many at once as there are problems and cores."""

import os
import threading

import pytest

from mpcc_controller.driving import parallel_solves
from mpcc_controller.driving.parallel_solves import ParallelSolves


class Solver:
    """A solver that only has the name of one that may run in threads."""

    name = parallel_solves.PARALLEL


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


def test_a_solver_that_hangs_is_not_waited_for_nor_used_until_it_returns(monkeypatch):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: {0, 1})
    pool, hangs, release = ParallelSolves(Solver, 3), threading.Event(), threading.Event()
    caller = threading.get_ident()

    def hang(solver):
        if threading.get_ident() != caller:
            hangs.set()
            release.wait(30.0)
        return solver

    try:
        _, results = pool.run(lambda: hangs.wait(30.0), [hang], lambda: 0.01)
        assert results == [None]
        threads = []
        for _ in range(3):
            _, results = pool.run(lambda: None, [lambda _: threads.append(threading.get_ident())])
        assert set(threads) == {caller}
    finally:
        release.set()
    _, results = pool.run(lambda: None, [hang] * 2)
    assert all(results)
