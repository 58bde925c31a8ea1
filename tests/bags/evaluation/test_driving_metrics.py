"""Braking time, counter-steering and use of the friction, known in closed form."""

import numpy as np
import pytest

from bags.evaluation import metrics
from bags.evaluation.metrics import driving

PERIOD_M = 20 * np.pi  # of the steering of the drive made by hand, 0.1 rad sin(x / 10 m)


def test_braking_lasts_as_long_as_the_force_is_below_the_threshold(make_drive):
    driven = make_drive(force=lambda x: np.where((x > 20.0) & (x < 60.0), -800.0, -100.0))
    assert driving.braking_time(driven, -500.0) == pytest.approx(2.0, abs=0.02)
    assert driving.braking_time(driven, -1500.0) == 0.0


def test_steering_against_the_turn_counts_where_both_have_a_side(make_drive):
    driven = make_drive(yaw=lambda x: 0.2 * np.cos(x / 10.0), metres=PERIOD_M)
    result = metrics.compute_metrics(driven)
    # |0.1 rad sin| > 1 deg is the narrower of both conditions
    share = 1 - 2 * np.arcsin(driving.STEERED_RAD / 0.1) / np.pi
    assert result['counter_steer_s'] == pytest.approx(share * PERIOD_M / 20.0, abs=0.05)
    assert result['peak_counter_steer_deg'] == pytest.approx(np.degrees(0.1), rel=1e-3)


@pytest.mark.parametrize('yaw', [0.0, lambda x: -0.2 * np.cos(x / 10.0)])
def test_steering_into_the_turn_or_straight_ahead_is_no_counter_steering(make_drive, yaw):
    result = metrics.compute_metrics(make_drive(yaw=yaw))
    assert (result['counter_steer_s'], result['peak_counter_steer_deg']) == (0.0, 0.0)


def test_peak_accelerations_are_shares_of_the_friction(make_drive):
    result = metrics.compute_metrics(make_drive(friction=0.8))
    assert result['peak_lat_acc_share'] == pytest.approx(8.0 / (0.8 * 9.81), rel=1e-3)
    assert result['peak_brake_share'] == pytest.approx(5.0 / (0.8 * 9.81))
