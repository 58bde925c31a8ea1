import numpy as np
import pytest

from experiments.tuning import objective
from experiments.tuning.objective import Score

SAFE = Score(1.0, 3.0, 0.0, 0.0, 0.0, 0.1)


def test_a_metre_per_second_counts_as_much_as_three_degrees():
    assert SAFE.cost == pytest.approx(2.0)
    assert objective.cost([SAFE, SAFE._replace(velocity_rms_mps=3.0)]) == pytest.approx(3.0)


def test_the_worst_drive_decides_about_safety():
    near = SAFE._replace(missing_v2o_m=0.2)
    lost = SAFE._replace(contouring_rms_m=0.5)
    found = objective.violations([SAFE, near, lost], tracking_m=0.3)
    assert found == pytest.approx((0.2, 0.0, 0.0, 0.2))
    assert objective.violations([SAFE], tracking_m=0.3) == (0.0, 0.0, 0.0, 0.0)


def test_a_steady_drive_is_scored_by_hand(make_drive):
    # 20 m/s and 2 m/s to the side, 21 m/s desired; 0.1 m off the path, edges 3 m from it
    found = objective.score(make_drive(y=0.1, vy=2.0), 21.0)
    assert found.velocity_rms_mps == pytest.approx(1.0)
    assert found.sideslip_peak_deg == pytest.approx(np.degrees(np.arctan2(2.0, 20.0)))
    assert found.missing_v2e_m == found.missing_v2o_m == found.not_completed == 0.0
    assert found.contouring_rms_m == pytest.approx(0.1)


def test_what_is_missing_of_a_safety_distance_is_counted(make_drive):
    # the circle of 1.1 m at y = 1.6 m is 0.3 m from the edge at 3 m, 0.5 m are safe
    assert objective.score(make_drive(y=1.6), 20.0).missing_v2e_m == pytest.approx(0.2)


def test_a_drive_that_stops_half_way_is_not_completed(make_drive):
    assert objective.score(make_drive(metres=40.0), 20.0).not_completed == 1.0
