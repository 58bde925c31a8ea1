"""What is made of the answers of a race: figures, ratios, tables."""

import json

import numpy as np
import pytest
import solver_report
import solver_variants
import summary
import tables
from assessment import GOOD, INFEASIBLE, OTHER_MINIMUM, Assessment
from interleaved_runs import COLD, POP_UP, WARM, Answer, Task, Timings
from solver_variants import BASELINE

LIMIT_S = 0.04


def timed(label_seconds):
    """A race with made-up times of three warm tasks, a cold one and a pop-up."""
    kinds = [WARM, WARM, WARM, COLD, POP_UP]
    task = [Task(kind, None, None, None, None) for kind in kinds]
    answer = [Answer(None, i, 'converged') for i in range(5)]
    return Timings(
        dict.fromkeys(label_seconds, task),
        dict.fromkeys(label_seconds, answer),
        {label: np.array(seconds) for label, seconds in label_seconds.items()},
    )


def figures():
    slow = [[0.010, 0.020, 0.040, 0.1, 0.2]] * 3
    # the median over the passes forgets that one pass was disturbed
    fast = [[0.001, 0.002, 0.004, 0.01, 0.02]] * 2 + [[0.9] * 5]
    verdicts = [Assessment(GOOD, 1e-6, 0.0)] * 4 + [Assessment(OTHER_MINIMUM, 1.0, 0.0)]
    ran = timed({'ours': fast, BASELINE: slow})
    return summary.summarize(ran, dict.fromkeys(('ours', BASELINE), verdicts), LIMIT_S)


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


def test_times_alone_are_listed_by_the_kind_of_start():
    ran = timed({'ours': [[0.001, 0.002, 0.003, 0.01, 0.02]], BASELINE: [[0.01, 0.02, 0.03, 1, 2]]})
    verdicts = [Assessment(GOOD, 0.0, 0.0)] * 5
    rows = summary.alone(ran, dict.fromkeys(('ours', BASELINE), verdicts))
    assert rows['ours'][WARM]['median_ms'] == pytest.approx(2.0)
    assert rows['ours'][COLD]['max_ms'] == pytest.approx(10.0)
    assert rows['ours'][POP_UP]['p99_ms'] == pytest.approx(20.0)
    assert rows['ours']['ratio_to_fatrop']['median'] == pytest.approx(0.1)
    assert solver_report.alone(rows).rows[0][-1] == '0.100'


def test_what_the_baseline_fails_at_does_not_flatter_the_others():
    verdicts = {
        'ours': [Assessment(GOOD, 0.0, 0.0)] * 5,
        BASELINE: [Assessment(GOOD, 0.0, 0.0)] * 2 + [Assessment(INFEASIBLE, np.nan, 1.0)] * 3,
    }
    ran = timed({'ours': [[0.001, 0.004, 0.005, 1, 1]], BASELINE: [[0.010, 0.010, 0.900, 1, 1]]})
    rows = summary.summarize(ran, verdicts, LIMIT_S)
    assert rows['ours']['ratio_to_fatrop']['max'] == pytest.approx(0.4)
    assert rows[BASELINE]['ratio_to_fatrop'] == {'median': 1, 'p99': 1, 'max': 1}
    nothing = {**verdicts, BASELINE: [Assessment(INFEASIBLE, np.nan, 1.0)] * 5}
    assert summary.summarize(ran, nothing, LIMIT_S)['ours']['ratio_to_fatrop'] is None


def test_the_json_has_what_was_agreed():
    text = solver_report.as_json({'cpu': 'a'}, 500, figures(), {'passes': 3})
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
    text_tables = [solver_report.timing(rows), solver_report.starts(rows)]
    for text_table in text_tables:
        assert all(len(row) == len(text_table.columns) for row in text_table.rows)
    text = solver_report.as_markdown({'cpu': 'a'}, '500 problems', text_tables, rows)
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


def test_late_answers_and_slow_problems_are_told():
    row = figures()[BASELINE]
    assert (row['pop_up_late'], row['pop_up_in_time_rate']) == (1, 0.0)
    assert figures()['ours']['pop_up_in_time_rate'] == 1.0
    slowest = row['slowest']
    assert [one['problem'] for one in slowest] == [2, 1, 0]
    assert slowest[0]['ms'] == pytest.approx([40.0] * 3)
    assert slowest[0]['iterations'] == 2
    text_table = solver_report.slowest(figures())
    assert text_table.rows[0] == ('2', '2', '4.00', '4.00', '900', 'converged')


def test_the_share_of_the_second_solver_is_told():
    ran = timed({'ours': [[0.001] * 5]})
    helped = ran.answers['ours'][3]._replace(message=f'{solver_variants.SECOND}solved')
    ran.answers['ours'][3] = helped
    row = summary.summarize(ran, {'ours': [Assessment(GOOD, 0.0, 0.0)] * 5}, LIMIT_S)['ours']
    shares = [row[f'{kind}second_share'] for kind in ('', 'cold_', 'pop_up_')]
    assert shares == [0.0, 1.0, 0.0]
