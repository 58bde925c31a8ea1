"""Verdicts: a drive that survives is shown, or why there is none."""

import numpy as np
import pytest

from bags.evaluation.metrics import compute_metrics
from experiments import simulation
from experiments.survivable import survival_search
from experiments.survivable.survival_search import survives

# the lane is left free by nobody: the controller brakes for the oncoming car and is hit
ONCOMING = [
    {'x_m': 130.0 + ahead, 'y_m': 0.0, 'radius_m': 1.05, 'vx_mps': -15.0} for ahead in (0.0, 2.7)
]


@pytest.fixture(scope='module')
def hit(straight_emergency):
    return straight_emergency(20.0, ONCOMING)


@pytest.fixture(scope='module')
def verdict(hit):
    return survival_search.survivable(hit, budget=100)


def test_an_emergency_that_a_controller_lost_is_proved_possible_by_a_drive(hit, verdict):
    assert not survives(simulation.drive(hit))
    assert verdict.answer == survival_search.POSSIBLE
    values = compute_metrics(verdict.drive)
    assert values['survived'] is True
    assert values['min_outline_gap_m'] > 0.0
    # of the same plant: it starts where every run starts
    assert verdict.drive.motion.x[0] == simulation.drive(hit).motion.x[0]


def test_the_same_arguments_give_the_same_verdict(hit, verdict):
    again = survival_search.survivable(hit, budget=100)
    assert again[:3] == verdict[:3]
    np.testing.assert_array_equal(again.drive.motion.y, verdict.drive.motion.y)


def test_what_no_car_can_stop_before_or_pass_is_impossible(straight_emergency):
    wall = [
        {'x_m': 44.0, 'y_m': -2.5 + 1.7 * i, 'radius_m': 1.0, 'appears_at_s': 1.5} for i in range(6)
    ]
    verdict = survival_search.survivable(straight_emergency(20.0, wall), budget=50)
    assert verdict.answer == survival_search.IMPOSSIBLE
    assert verdict.drive is None


def test_without_a_drive_or_a_bound_it_stays_undecided(straight_emergency):
    """A car needs longer than a point to move aside: no point is stopped by this, but every car."""
    late = {'x_m': 40.0 + 16.5, 'y_m': 0.0, 'radius_m': 1.3, 'appears_at_s': 2.0}
    verdict = survival_search.survivable(straight_emergency(20.0, [late]), budget=12)
    assert verdict.answer == survival_search.UNDECIDED
    assert verdict.rollouts >= 12
