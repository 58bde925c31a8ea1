"""The race: own warm starts, fair turns, and the figures made of its times."""

import json
from itertools import pairwise

import numpy as np
import one_step
import pytest
import race
import report
import scaling
import start_up
import summary
import tables
import variants
from loops import Loop
from race import COLD, FIRST, POP_UP, WARM, Answer, Race, Task
from variants import BASELINE, NATIVE, Variant
from verdict import GOOD, INFEASIBLE, OTHER_MINIMUM, Verdict

from mpcc_controller.solvers import solver
from mpcc_controller.solvers.shooting import Plan
from mpcc_controller.solvers.solver import FAILED, SOLVED, Solution, SolverOptions

LIMIT_S = 0.04
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
    return race.tasks(problem, recorded, params.fallback, solver.make(problem, FATROP), 5)


def test_only_the_first_tick_of_a_loop_starts_cold_unasked(given, recorded):
    kinds = [task.kind for task in given]
    assert kinds == [FIRST, *[WARM] * 6] * 2 + [COLD] * 3 + [POP_UP] * 2
    for task, k in zip(given[14:17], (0, 5, 10)):
        np.testing.assert_array_equal(task.start.X, recorded.cold_X[k])
        np.testing.assert_array_equal(task.P, recorded.cold_P[k])


def test_a_warm_start_is_the_solvers_own_plan_moved_on(given, problem, recorded):
    made = solver.make(problem, FATROP)
    for before, after in pairwise(given[2:7]):
        plan = made.solve(*before[1:]).plan
        np.testing.assert_allclose(after.start.U[:-1], plan.U[1:], atol=1e-9)
        assert after.start.multipliers is not None
        np.testing.assert_array_equal(after.start.X[0], after.x0)


def test_a_pop_up_starts_as_the_tick_it_surprises(given, recorded):
    for task, k in zip(given[17:], recorded.pop_up):
        assert task.start is given[k].start
        assert not np.array_equal(task.P, given[k].P)


def test_a_solver_that_fails_gets_the_cold_starts_of_the_controller(problem, recorded, params):
    refuses = Refuses()
    tasks = race.tasks(problem, recorded, params.fallback, refuses, 100)
    assert [task.kind for task in tasks[:7]] == [FIRST, *[WARM] * 6]
    for k, start in enumerate(refuses.starts[:7]):
        np.testing.assert_array_equal(start.X, recorded.cold_X[k])


def test_the_solvers_take_turns_on_every_task_and_nobody_always_begins():
    calls = []
    solvers = {label: Listed(label, calls) for label in 'abc'}
    tasks = {label: [(WARM, i) for i in range(4)] for label in 'abc'}
    ticks = []
    ran = race.run(solvers, tasks, 2, lambda: ticks.append(1))
    assert [number for number, _ in calls] == [i for i in range(4) for _ in 'abc'] * 2
    rounds = [[label for _, label in calls[i : i + 3]] for i in range(0, 24, 3)]
    assert all(sorted(one) == list('abc') for one in rounds)
    assert {one[0] for one in rounds} == set('abc')
    assert len(ticks) == 8
    assert all(seconds.shape == (2, 4) and (seconds > 0).all() for seconds in ran.seconds.values())


def timed(label_seconds):
    """A race with made-up times of three warm tasks, a cold one and a pop-up."""
    kinds = [WARM, WARM, WARM, COLD, POP_UP]
    task = [Task(kind, None, None, None, None) for kind in kinds]
    answer = [Answer(None, i, 'converged') for i in range(5)]
    return Race(
        dict.fromkeys(label_seconds, task),
        dict.fromkeys(label_seconds, answer),
        {label: np.array(seconds) for label, seconds in label_seconds.items()},
    )


def figures():
    slow = [[0.010, 0.020, 0.040, 0.1, 0.2]] * 3
    # the median over the passes forgets that one pass was disturbed
    fast = [[0.001, 0.002, 0.004, 0.01, 0.02]] * 2 + [[0.9] * 5]
    verdicts = [Verdict(GOOD, 1e-6, 0.0)] * 4 + [Verdict(OTHER_MINIMUM, 1.0, 0.0)]
    ran = timed({'ours': fast, BASELINE: slow})
    return summary.of(ran, dict.fromkeys(('ours', BASELINE), verdicts), LIMIT_S)


def test_times_are_medians_over_the_passes_and_ratios_those_of_the_figures():
    row = figures()['ours']
    assert row['median_ms'] == pytest.approx(2.0)
    assert row['max_ms'] == pytest.approx(4.0)
    assert row['raw_max_ms'] == pytest.approx(900.0)
    assert row['cold_median_ms'] == pytest.approx(10.0)
    assert row['pop_up_max_ms'] == pytest.approx(20.0)
    assert row['ratio_to_fatrop'] == pytest.approx({'median': 0.1, 'p99': 0.1, 'max': 0.1})
    assert row['median_iterations'] == 1
    assert row['success_rate'] == row['pop_up_success_rate'] == 1.0
    assert row['pop_up_other_minima'] == 1


def test_what_the_baseline_fails_at_does_not_flatter_the_others():
    verdicts = {
        'ours': [Verdict(GOOD, 0.0, 0.0)] * 5,
        BASELINE: [Verdict(GOOD, 0.0, 0.0)] * 2 + [Verdict(INFEASIBLE, np.nan, 1.0)] * 3,
    }
    ran = timed({'ours': [[0.001, 0.004, 0.005, 1, 1]], BASELINE: [[0.010, 0.010, 0.900, 1, 1]]})
    rows = summary.of(ran, verdicts, LIMIT_S)
    assert rows['ours']['ratio_to_fatrop']['max'] == pytest.approx(0.4)
    assert rows[BASELINE]['ratio_to_fatrop'] == {'median': 1, 'p99': 1, 'max': 1}
    nothing = {**verdicts, BASELINE: [Verdict(INFEASIBLE, np.nan, 1.0)] * 5}
    assert summary.of(ran, nothing, LIMIT_S)['ours']['ratio_to_fatrop'] is None


def test_the_json_has_what_was_agreed():
    text = report.as_json({'cpu': 'a'}, 500, figures(), {'passes': 3})
    read = json.loads(text)
    assert read['problems'] == 500
    assert set(read['solvers']) == {'ours', BASELINE}
    agreed = {
        'median_ms',
        'p99_ms',
        'max_ms',
        'median_iterations',
        'success_rate',
        'cold_success_rate',
        'max_cost_gap',
    }
    for row in read['solvers'].values():
        assert agreed <= set(row)
        assert all(isinstance(row[key], int | float) for key in agreed)


def test_every_row_of_a_table_has_a_cell_per_column():
    rows = figures()
    sheets = [report.timing(rows), report.starts(rows)]
    for sheet in sheets:
        assert all(len(row) == len(sheet.columns) for row in sheet.rows)
    text = report.as_markdown({'cpu': 'a'}, '500 problems', sheets, rows)
    assert 'Not in this version: ours_one_step.' in text
    lines = [line for line in text.splitlines() if line.startswith('| ours |')]
    assert lines[0].split(' | ')[1:4] == ['2.00', '3.96', '4.00']
    assert lines[0].endswith('0.100 | 0.100 | 0.100 |')


def test_a_hundred_per_cent_means_all():
    assert tables.share(1.0) == '100 %'
    assert tables.share(0.99999) == '99.9 %'
    assert [tables.number(v) for v in (123.4, 12.34, 1.234, 0.1234)] == [
        '123',
        '12.3',
        '1.23',
        '0.123',
    ]


def test_every_solver_of_the_project_is_measured(params):
    labels = [variant.label for variant in variants.available(params, interpreted=True)]
    assert {BASELINE, NATIVE, 'ipopt_c', 'fatrop_vm', 'ipopt_vm'} <= set(labels)
    found = variants.available(params, interpreted=False)
    labels = [variant.label for variant in found]
    assert labels == ['ours', 'ours_one_step', BASELINE, NATIVE, 'ipopt_c']


class Answers:
    """A solver with one answer, which notes its time limits."""

    def __init__(self, status, solve_s):
        self.status, self.solve_s, self.limits = status, solve_s, []

    def limit(self, seconds):
        self.limits.append(seconds)

    def solve(self, x0, P, bounds, guess):
        return Solution(guess, 1.0, self.status, 'told', 3, 1e-9, 1e-9, self.solve_s)


def test_a_second_solver_is_asked_after_a_failure_and_its_time_and_iterations_count(given, params):
    warm = given[4]
    second = Answers(SOLVED, 0.02)
    aided = variants.Aided(Answers(FAILED, 0.015), second, params)
    found = aided.solve(*warm[1:])
    assert (found.status, found.iterations) == (SOLVED, 6)
    assert found.solve_s == pytest.approx(0.035)
    assert second.limits == [pytest.approx(0.025)]  # of the 40 ms that both have
    assert found.message == f'{variants.SECOND}told'
    assert found.plan.multipliers is None  # the next solve starts as the controller would


def test_a_second_solver_is_not_asked_while_the_first_one_may_be_driven(given, params):
    first, second = Answers(SOLVED, 0.001), Answers(SOLVED, 0.02)
    found = variants.Aided(first, second, params).solve(*given[4][1:])
    assert found == first.solve(*given[4][1:])
    assert not second.limits


def test_one_step_is_one_step_from_a_plan_and_all_of_them_from_none(problem, recorded, params):
    chosen = variants.available(params, interpreted=False)[:2]
    assert [one.label for one in chosen] == [variants.OURS, variants.ONE_STEP]
    made = variants.make(problem, chosen, params)
    tasks = race.tasks(problem, recorded, params.fallback, made[variants.OURS], 5)
    warm = [task for task in tasks if task.kind == WARM]
    iterations = {
        label: [one.solve(*task[1:]).iterations for task in warm] for label, one in made.items()
    }
    assert min(iterations[variants.ONE_STEP]) == 1
    assert np.all(np.less_equal(iterations[variants.ONE_STEP], iterations[variants.OURS]))
    assert sum(iterations[variants.ONE_STEP]) < 0.9 * sum(iterations[variants.OURS])
    cold = next(task for task in tasks if task.kind == COLD)
    assert made[variants.ONE_STEP].solve(*cold[1:]).iterations > 1


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
    (row,) = scaling.measured(scaling.sized(params, size), size, chosen)
    assert (row['horizon'], row['obstacles'], row['circles']) == size
    assert row['median_ms'] > 0
    per_stage = row['us_per_iteration_and_stage'] * row['median_iterations'] * 5 / 1e3
    assert per_stage == pytest.approx(row['median_ms'], rel=0.5)


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


def test_late_answers_and_slow_problems_are_told():
    row = figures()[BASELINE]
    assert (row['pop_up_late'], row['pop_up_in_time_rate']) == (1, 0.0)
    assert figures()['ours']['pop_up_in_time_rate'] == 1.0
    slowest = row['slowest']
    assert [one['problem'] for one in slowest] == [2, 1, 0]
    assert slowest[0]['ms'] == pytest.approx([40.0] * 3)
    assert slowest[0]['iterations'] == 2
    sheet = report.slowest(figures())
    assert sheet.rows[0] == ('2', '2', '4.00', '4.00', '900', 'converged')


def test_the_share_of_the_second_solver_is_told():
    ran = timed({'ours': [[0.001] * 5]})
    helped = ran.answers['ours'][3]._replace(message=f'{variants.SECOND}solved')
    ran.answers['ours'][3] = helped
    row = summary.of(ran, {'ours': [Verdict(GOOD, 0.0, 0.0)] * 5}, LIMIT_S)['ours']
    shares = [row[f'{kind}second_share'] for kind in ('', 'cold_', 'pop_up_')]
    assert shares == [0.0, 1.0, 0.0]
