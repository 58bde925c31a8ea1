"""Interleaved runs: warm starts of each solver, equal turns, and the figures of their times."""

import time
from itertools import pairwise
from types import SimpleNamespace

import interleaved_runs
import numpy as np
import one_step
import pytest
import scaling
import solver_variants
import start_up
from closed_loops import Loop
from interleaved_runs import COLD, FIRST, POP_UP, WARM
from solver_variants import BASELINE, NATIVE, Variant

from stage_solver.solution import FAILED, SOLVED, Solution, SolverOptions
from stage_solver.solver import make_solver
from stage_solver.stage_problem import Plan

FATROP = SolverOptions('fatrop', 100, 1e-6, None, compiled=False)


class Refuses:
    """A solver that never succeeds."""

    def __init__(self):
        self.starts = []

    def solve(self, x0, P, bounds, guess):
        self.starts.append(guess)
        return Solution(guess, 0.0, FAILED, 'refused', 0, np.inf, np.inf, 0.0)


class Listed:
    """A solver that writes down when it is called."""

    def __init__(self, label, calls):
        self.label, self.calls = label, calls

    def solve(self, number):
        self.calls.append((number, self.label))
        return Solution(Plan(np.zeros(1), np.zeros(1)), 0.0, '', '', number, 0.0, 0.0, 0.0)


@pytest.fixture(scope='module')
def given(problem, recorded, params):
    return interleaved_runs.tasks(
        problem, recorded, params.fallback, make_solver(problem, FATROP), 5
    )


def test_only_the_first_tick_of_a_loop_has_to_start_cold(given, recorded):
    kinds = [task.kind for task in given]
    assert kinds == [FIRST, *[WARM] * 6] * 2 + [COLD] * 3 + [POP_UP] * 2
    for task, k in zip(given[14:17], (0, 5, 10)):
        np.testing.assert_array_equal(task.start.X, recorded.cold_X[k])
        np.testing.assert_array_equal(task.P, recorded.cold_P[k])


def test_a_warm_start_is_the_solvers_own_plan_moved_on(given, problem, recorded):
    made = make_solver(problem, FATROP)
    for before, after in pairwise(given[2:7]):
        plan = made.solve(*before.arguments).plan
        np.testing.assert_allclose(after.start.U[:-1], plan.U[1:], atol=1e-9)
        assert after.start.multipliers is not None
        np.testing.assert_array_equal(after.start.X[0], after.x0)


def test_a_pop_up_starts_as_the_tick_it_surprises(given, recorded):
    for task, k in zip(given[17:], recorded.pop_up):
        assert task.start is given[k].start
        assert not np.array_equal(task.P, given[k].P)


def test_a_solver_that_fails_gets_the_cold_starts_of_the_controller(problem, recorded, params):
    refuses = Refuses()
    tasks = interleaved_runs.tasks(problem, recorded, params.fallback, refuses, 100)
    assert [task.kind for task in tasks[:7]] == [FIRST, *[WARM] * 6]
    for k, start in enumerate(refuses.starts[:7]):
        np.testing.assert_array_equal(start.X, recorded.cold_X[k])


def test_the_solvers_take_turns_on_every_task_and_begin_equally_often():
    calls = []
    solvers = {label: Listed(label, calls) for label in 'abc'}
    tasks = {label: [SimpleNamespace(arguments=(i,)) for i in range(4)] for label in 'abc'}
    ticks = []
    ran = interleaved_runs.run(solvers, tasks, 2, lambda: ticks.append(1))
    assert [number for number, _ in calls] == [i for i in range(4) for _ in 'abc'] * 2
    rounds = [[label for _, label in calls[i : i + 3]] for i in range(0, 24, 3)]
    assert all(sorted(one) == list('abc') for one in rounds)
    assert {one[0] for one in rounds} == set('abc')
    assert len(ticks) == 8
    assert all(seconds.shape == (2, 4) and (seconds > 0).all() for seconds in ran.seconds.values())


def test_solvers_that_run_alone_take_all_tasks_one_solver_after_the_other():
    calls = []
    solvers = {label: Listed(label, calls) for label in 'ab'}
    tasks = {label: [SimpleNamespace(arguments=(i,)) for i in range(3)] for label in 'ab'}
    ran = interleaved_runs.run_alone(solvers, tasks, 2, lambda: None)
    assert calls == [(i, label) for label in 'ab' for _ in range(2) for i in range(3)]
    assert {label: seconds.shape for label, seconds in ran.seconds.items()} == {
        'a': (2, 3),
        'b': (2, 3),
    }


def test_every_solver_of_the_project_is_measured(params):
    labels = [variant.label for variant in solver_variants.available(params, interpreted=True)]
    assert {BASELINE, NATIVE, 'ipopt_c', 'fatrop_vm', 'ipopt_vm'} <= set(labels)
    found = solver_variants.available(params, interpreted=False)
    labels = [variant.label for variant in found]
    assert labels == ['ours', 'ours_one_step', BASELINE, NATIVE, 'ipopt_c']


class Answers:
    """A solver with one answer, which notes its time limits."""

    def __init__(self, status, solve_s):
        self.status, self.solve_s, self.limits = status, solve_s, []

    def set_time_limit(self, seconds):
        self.limits.append(seconds)

    def solve(self, x0, P, bounds, guess):
        return Solution(guess, 1.0, self.status, 'text', 3, 1e-9, 1e-9, self.solve_s)


def test_a_second_solver_is_called_after_a_failure_and_its_time_and_iterations_count(given, params):
    warm = given[4]
    second = Answers(SOLVED, 0.02)
    solver = solver_variants.WithSecondSolver(Answers(FAILED, 0.015), second, params)
    found = solver.solve(*warm.arguments)
    assert (found.status, found.iterations) == (SOLVED, 6)
    assert found.solve_s == pytest.approx(0.035)
    assert second.limits == [pytest.approx(0.025)]  # of the 40 ms that both have
    assert found.message == f'{solver_variants.SECOND}text'
    assert found.plan.multipliers is None  # the next solve starts as the controller would


def test_a_second_solver_is_not_called_while_the_first_plan_is_acceptable(given, params):
    first, second = Answers(SOLVED, 0.001), Answers(SOLVED, 0.02)
    found = solver_variants.WithSecondSolver(first, second, params).solve(*given[4].arguments)
    assert found == first.solve(*given[4].arguments)
    assert not second.limits


def test_one_step_is_one_step_from_a_plan_and_all_of_them_from_none(problem, recorded, params):
    chosen = solver_variants.available(params, interpreted=False)[:2]
    assert [one.label for one in chosen] == [solver_variants.OURS, solver_variants.ONE_STEP]
    made = solver_variants.make_solvers(problem, chosen, params)
    tasks = interleaved_runs.tasks(
        problem, recorded, params.fallback, made[solver_variants.OURS], 5
    )
    warm = [task for task in tasks if task.kind == WARM]
    iterations = {
        label: [one.solve(*task.arguments).iterations for task in warm]
        for label, one in made.items()
    }
    assert min(iterations[solver_variants.ONE_STEP]) == 1
    assert np.all(
        np.less_equal(iterations[solver_variants.ONE_STEP], iterations[solver_variants.OURS])
    )
    assert sum(iterations[solver_variants.ONE_STEP]) < 0.9 * sum(iterations[solver_variants.OURS])
    cold = next(task for task in tasks if task.kind == COLD)
    assert made[solver_variants.ONE_STEP].solve(*cold.arguments).iterations > 1


def test_scaling_covers_horizons_obstacles_and_circles(params):
    all_sizes = scaling.sizes(scaling.sized(params, scaling.Size(50, 4, 1)))
    assert len(all_sizes) == len(set(all_sizes)) == 9
    assert {size.horizon for size in all_sizes} == {25, 50, 100, 200}
    assert {(s.obstacles, s.circles) for s in all_sizes} == {
        (o, c) for o in (1, 4, 10) for c in (1, 3)
    }


def test_a_size_is_measured_at_that_size(params):
    size = scaling.Size(horizon=5, obstacles=2, circles=3)
    chosen = [Variant('fatrop_vm', FATROP)]
    began = time.perf_counter()
    (row,) = scaling.measured(scaling.sized(params, size), size, chosen)
    passed_ms = (time.perf_counter() - began) * 1e3
    assert (row['solver'], row['horizon'], row['obstacles'], row['circles']) == ('fatrop', *size)
    # at least half of the ticks take the median, in every pass
    ticks = len(scaling.ROAD.ticks) // 2 * scaling.PASSES
    assert 0 < row['median_ms'] * ticks < passed_ms
    assert 1 <= row['median_iterations'] <= FATROP.max_iterations


def test_the_cost_of_a_size_is_per_task_iteration_and_stage():
    seconds = np.array([[1.0, 8.0, 6.0], [3.0, 8.0, 6.0], [2.0, 8.0, 60.0]]) * 1e-3
    answers = [Listed('a', []).solve(iterations) for iterations in (4, 2, 0)]
    ran = interleaved_runs.Timings({'a': []}, {'a': answers}, {'a': seconds})
    row = scaling.figures_of('ours', ran, 'a', scaling.Size(horizon=10, obstacles=1, circles=1))
    # tasks take 2, 8 and 6 ms in the median: 50, 400 and, without an iteration, 600 us
    assert row['us_per_iteration_and_stage'] == pytest.approx(400.0)
    assert (row['median_ms'], row['median_iterations']) == (pytest.approx(6.0), 2.0)


def test_the_cache_is_empty_once_and_afterwards_as_before(monkeypatch, tmp_path):
    monkeypatch.setenv(start_up.CACHE, str(tmp_path))
    with start_up.empty_cache():
        inside = start_up.os.environ[start_up.CACHE]
        assert not start_up.os.listdir(inside)
    assert start_up.os.environ[start_up.CACHE] == str(tmp_path)
    assert not start_up.os.path.exists(inside)


def test_a_drive_with_converged_plans_has_a_plan_at_every_tick(params):
    loop = Loop('straight', 'straight', 'mpcc', None, range(1))
    first, second = (one_step.driven(loop, params, 'converged', {}) for _ in range(2))
    assert (first.cost, first.ticks) == (second.cost, second.ticks)
    assert first.unplanned == 0
    assert 78 <= first.ticks <= 82  # 60 m at 15 m/s
    assert 0 < first.cost < 1
    assert first.more_share > 0.9
    assert first.prepare_ms == 0
    stepped = one_step.driven(loop, params, *one_step.SCHEMES['one_step_prepared'])
    assert stepped.cost == pytest.approx(first.cost, rel=0.01)
    assert stepped.more_share < 0.5
    assert stepped.prepare_ms > 0
