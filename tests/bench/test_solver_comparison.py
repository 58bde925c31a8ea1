"""The comparison of solvers: equal turns, and the figures of their times and answers."""

import numpy as np
import one_step
import pytest
import solver_comparison
from assessment import GOOD, INFEASIBLE, OTHER_MINIMUM, Assessment
from closed_loops import Loop
from problems import COLD, POP_UP, WARM, Task
from solver_comparison import BASELINE, NATIVE, Answer
from tables import markdown, number, share

from stage_solver.solution import Solution
from stage_solver.stage_problem import Plan

MARKED = [WARM, WARM, WARM, COLD, POP_UP]


class Listed:
    """A solver that writes down when it is called."""

    def __init__(self, label, calls):
        self.label, self.calls = label, calls

    def solve(self, number):
        self.calls.append((number, self.label))
        return Solution(Plan(np.zeros(1), np.zeros(1)), 0.0, '', '', number, 0.0, 0.0, 0.0)


def test_the_solvers_take_turns_on_every_task_and_begin_equally_often():
    calls = []
    solvers = {label: Listed(label, calls) for label in 'abc'}
    tasks = {label: [(WARM, i) for i in range(4)] for label in 'abc'}
    ticks = []
    _, seconds = solver_comparison.run(solvers, tasks, 2, lambda: ticks.append(1))
    assert [number for number, _ in calls] == [i for i in range(4) for _ in 'abc'] * 2
    rounds = [[label for _, label in calls[i : i + 3]] for i in range(0, 24, 3)]
    assert all(sorted(labels) == list('abc') for labels in rounds)
    assert {labels[0] for labels in rounds} == set('abc')
    assert len(ticks) == 8
    assert all(own.shape == (2, 4) and (own > 0).all() for own in seconds.values())


def test_every_solver_of_the_project_is_measured(params):
    labels = [one.label for one in solver_comparison.available(params, interpreted=True)]
    assert {BASELINE, NATIVE, 'ipopt_c', 'fatrop_vm', 'ipopt_vm'} <= set(labels)
    labels = [one.label for one in solver_comparison.available(params, interpreted=False)]
    assert labels == ['ours', 'ours_one_step', BASELINE, NATIVE, 'ipopt_c']


def driven(qualities):
    """Made-up times of three warm tasks, a cold one and a pop-up of two solvers."""
    tasks = [Task(kind, None, None, None, None) for kind in MARKED]
    answers = [Answer(None, i, 'converged') for i in range(5)]
    slow = np.array([[0.010, 0.020, 0.040, 0.1, 0.2]] * 3)
    # the median over the passes forgets that one pass was disturbed
    fast = np.array([[0.001, 0.002, 0.004, 0.01, 0.02]] * 2 + [[0.9] * 5])
    table = solver_comparison.pd.concat(
        solver_comparison.table_of(label, tasks, answers, qualities[label], times, times / 2)
        for label, times in (('ours', fast), (BASELINE, slow))
    )
    rows = solver_comparison.summarise(table)
    return table, {(row['start'], row['solver']): row for row in rows.to_dict('records')}


WELL = [Assessment(GOOD, 1e-6, 0.0)] * 4 + [Assessment(OTHER_MINIMUM, 1.0, 0.0)]


def test_times_are_medians_over_the_passes_and_ratios_those_of_the_figures():
    table, rows = driven({'ours': WELL, BASELINE: WELL})
    warm, pop_up = rows[WARM, 'ours'], rows[POP_UP, 'ours']
    assert (warm['median'], warm['max']) == pytest.approx((2.0, 4.0))
    assert warm['alone: median'] == pytest.approx(1.0)
    assert rows[COLD, 'ours']['median'] == pytest.approx(10.0)
    assert pop_up['max'] == pytest.approx(20.0)
    assert warm[f'/ {BASELINE}: median'] == pytest.approx(0.1)
    assert warm['iterations'] == '1 / 2'
    assert warm['good'] == pop_up['good'] == 1.0
    assert (warm['max gap'], pop_up['other minima']) == (1e-6, 1)
    starts, slowest = solver_comparison.texts(table)
    assert (
        '| warm | ours | 2.00 | 3.96 | 4.00 | 1 / 2 | 100 % | 0 | 1e-06 | 0e+00 | 0.100 |' in starts
    )
    assert slowest.splitlines()[4] == '| 2 | 2 | 4.00 | 4.00 | 900 | converged |'


def test_what_the_baseline_fails_at_does_not_flatter_the_others():
    failing = WELL[:2] + [Assessment(INFEASIBLE, np.nan, 1.0)] * 3
    _, rows = driven({'ours': WELL, BASELINE: failing})
    assert rows[WARM, BASELINE]['good'] == pytest.approx(2 / 3)
    assert rows[WARM, 'ours'][f'/ {BASELINE}: max'] == pytest.approx(0.1)
    assert np.isnan(rows[COLD, 'ours'][f'/ {BASELINE}: median'])


def test_numbers_have_three_digits_and_a_hundred_per_cent_means_all():
    assert (share(1.0), share(0.99999)) == ('100 %', '99.9 %')
    values = (123.4, 12.34, 1.234, 0.1234, np.nan)
    assert [number(value) for value in values] == ['123', '12.3', '1.23', '0.123', '-']
    assert markdown('A', ('b', 'c'), [('d', 1)]) == '## A\n\n| b | c |\n| --- | ---: |\n| d | 1 |\n'


def test_a_drive_with_converged_plans_has_a_plan_at_every_tick(params):
    loop = Loop('straight', 'straight', 'mpcc', None, range(1))
    schemes = one_step.SCHEMES
    first, second = (one_step.driven(loop, params, schemes['converged']) for _ in range(2))
    assert (first.cost, first.ticks) == (second.cost, second.ticks)
    assert first.unplanned == 0
    assert 78 <= first.ticks <= 82  # 60 m at 15 m/s
    assert 0 < first.cost < 1
    assert first.more_share > 0.9
    assert first.prepare_ms == 0
    stepped = one_step.driven(loop, params, schemes['one_step_prepared'])
    assert stepped.cost == pytest.approx(first.cost, rel=0.01)
    assert stepped.more_share < 0.5
    assert stepped.prepare_ms > 0
