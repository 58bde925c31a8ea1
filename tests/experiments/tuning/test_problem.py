"""Objective, constraints and ranges of the search."""

import numpy as np
import pytest

from bags.errors import BagError
from experiments.tuning import problem
from experiments.tuning.problem import Score

SAFE = Score(1.0, 3.0, 0.0, 0.0, 0.0, 0.1)


def test_a_metre_per_second_counts_as_much_as_three_degrees():
    assert SAFE.cost == pytest.approx(2.0)
    assert problem.cost([SAFE, SAFE._replace(velocity_rms_mps=3.0)]) == pytest.approx(3.0)


def test_the_violations_are_those_of_the_worst_run():
    near = SAFE._replace(missing_v2o_m=0.2)
    lost = SAFE._replace(contouring_rms_m=0.5)
    found = problem.violations([SAFE, near, lost], tracking_m=0.3)
    assert found == pytest.approx((0.2, 0.0, 0.0, 0.2))
    assert problem.violations([SAFE], tracking_m=0.3) == (0.0, 0.0, 0.0, 0.0)


def test_the_score_of_a_steady_run_equals_a_hand_calculation(make_drive):
    # 20 m/s and 2 m/s to the side, 21 m/s desired; 0.1 m off the path, edges 3 m from it
    found = problem.score(make_drive(y=0.1, vy=2.0), 21.0)
    assert found.velocity_rms_mps == pytest.approx(1.0)
    assert found.sideslip_peak_deg == pytest.approx(np.degrees(np.arctan2(2.0, 20.0)))
    assert found.missing_v2e_m == found.missing_v2o_m == found.not_completed == 0.0
    assert found.contouring_rms_m == pytest.approx(0.1)


def test_a_violated_safety_distance_counts_by_its_amount(make_drive):
    # the circle of 1.1 m at y = 1.6 m is 0.3 m from the edge at 3 m, 0.5 m are safe
    assert problem.score(make_drive(y=1.6), 20.0).missing_v2e_m == pytest.approx(0.2)


def test_a_run_that_stops_half_way_is_not_completed(make_drive):
    assert problem.score(make_drive(metres=40.0), 20.0).not_completed == 1.0


def test_both_controllers_search_the_same_ranges_but_for_one_term_each():
    mpcc, frenet = (
        problem.wide_spans(problem.untuned_weights(name)) for name in ('mpcc', 'frenet')
    )
    common = set(mpcc) & set(frenet)
    assert len(common) == 6
    assert all(mpcc[name] == frenet[name] for name in common)
    assert set(mpcc) - common == {'tolerances.lag_m'}
    assert set(frenet) - common == {'tolerances.heading_rad'}


def test_the_first_stage_is_as_wide_below_the_untuned_weight_as_above():
    for name, span in problem.wide_spans({'a': 0.5, 'b': 2e4}).items():
        centre = {'a': 0.5, 'b': 2e4}[name]
        assert span.high / centre == pytest.approx(centre / span.low)


def test_the_second_stage_is_narrower_and_holds_the_best_of_the_first():
    wide = problem.wide_spans({'inner': 1.0, 'rim': 1.0})
    best = {'inner': 2.0, 'rim': wide['rim'].high}
    narrow = problem.narrow_spans(wide, best)
    assert narrow['inner'].decades == pytest.approx(wide['inner'].decades / problem.NARROWING)
    assert narrow['rim'].high == wide['rim'].high
    assert all(narrow[name].low <= best[name] <= narrow[name].high for name in best)


def test_a_weight_of_zero_cannot_be_searched_for():
    with pytest.raises(BagError, match=r'priorities\.obstacle is 0'):
        problem.untuned_weights('mpcc_no_ca')
