"""How often, how fast and by what a drive was answered."""

import numpy as np
import pytest

from bags.evaluation import metrics
from bags.evaluation.metrics import driving

MS = 1_000_000


def test_ticks_without_a_command_are_misses(make_drive):
    driven = make_drive()
    assert metrics.compute_metrics(driven)['ticks'] == 100
    assert metrics.compute_metrics(driven)['deadline_misses'] == 0
    kept = np.delete(driven.ticks.answered_ns, [3, 4, 50])
    late = driven._replace(ticks=driven.ticks._replace(answered_ns=kept))
    assert metrics.compute_metrics(late)['deadline_misses'] == 3


def test_the_time_before_the_first_command_is_no_miss(make_drive):
    driven = make_drive()
    # on the wall clock the car is held until then, and the first answer is to any state
    answered = driven.ticks.answered_ns[20:] + 7 * MS
    held = driven._replace(ticks=driven.ticks._replace(answered_ns=answered))
    result = metrics.compute_metrics(held)
    assert (result['ticks'], result['deadline_misses']) == (80, 0)
    never = driven._replace(ticks=driven.ticks._replace(answered_ns=answered[:0]))
    assert metrics.compute_metrics(never)['deadline_misses'] == 100


def test_a_command_for_any_state_of_its_period_serves_that_tick(make_drive):
    driven = make_drive()
    shifted = driven.ticks._replace(answered_ns=driven.ticks.answered_ns + 7 * MS)
    assert metrics.compute_metrics(driven._replace(ticks=shifted))['deadline_misses'] == 0


def test_solve_times_and_fallbacks_are_the_controllers_own(make_drive):
    driven = make_drive()
    solve = np.arange(1.0, 101.0)
    rung = (solve > 97.0).astype(float)
    result = metrics.compute_metrics(
        driven._replace(ticks=driven.ticks._replace(solve_ms=solve, fallback=rung))
    )
    assert result['solve_ms'] == pytest.approx(
        {'mean': 50.5, 'p50': 50.5, 'p99': 99.01, 'max': 100}
    )
    assert result['solve_cpu_ms']['max'] == 4.0
    assert result['fallbacks'] == 3


def test_a_solve_that_stopped_early_counts_where_its_plan_was_followed(make_drive):
    driven = make_drive()
    fallback, converged = np.zeros(100, dtype=bool), np.ones(100, dtype=bool)
    fallback[:3], converged[:7] = True, False
    ticks = driven.ticks._replace(fallback=fallback, converged=converged)
    assert metrics.compute_metrics(driven._replace(ticks=ticks))['stopped_early'] == 4
    unknown = driven.ticks._replace(converged=converged[:0])
    assert metrics.compute_metrics(driven._replace(ticks=unknown))['stopped_early'] == 0


def test_without_a_single_solve_there_are_no_solve_times():
    assert driving.time_statistics(np.array([])) == dict.fromkeys(('mean', 'p50', 'p99', 'max'))
