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
