"""The share of P_k at which the step pushes as the Gaussian does."""

import numpy as np
import pytest

from experiments.study import undisturbed_run, variants


def test_the_share_is_that_of_the_slopes_of_the_costs():
    depth, h = np.linspace(0.05, 0.95, 19), 1e-6

    def gaussian(D):
        return np.exp(-2 * D**2) * (D - 1) ** 2

    def step(D):
        return (D - 1) ** 2

    slopes = [cost(depth + h) - cost(depth - h) for cost in (gaussian, step)]
    assert undisturbed_run.gaussian_force_share(depth) == pytest.approx(
        slopes[0] / slopes[1], rel=1e-6
    )


def test_deep_intrusions_weigh_alike_and_shallow_ones_a_seventh():
    assert undisturbed_run.summarise_intrusions(np.array([0.0])).force_share == 1.0
    rim = undisturbed_run.summarise_intrusions(np.array([1 - 1e-9]))
    assert rim.force_share == pytest.approx(np.exp(-2))
    assert rim.cost_share == pytest.approx(np.exp(-2))


@pytest.fixture(scope='module')
def mpcc():
    return undisturbed_run.simulate(variants.plain_variants(['mpcc'])[0], 75.0)


def test_equal_penalty_is_what_the_mpcc_plans_with_at_the_operating_point(mpcc):
    found = undisturbed_run.planned_intrusions(mpcc)
    assert found.stages > 100
    assert found.force_share == pytest.approx(variants.EQUAL_PENALTY, rel=0.1)


def test_on_the_double_lane_change_the_frame_shifts_a_distance_by_less_than_a_metre(mpcc):
    first, second = undisturbed_run.view_obstacles(mpcc)
    for one in (first, second):
        assert 0.0 < one.most_over_m < 1.0
        assert one.most_under_m < 1.0
    # the horizon of 2.5 s sees the first one from its own 52 m before it
    assert 68.2 - 60.0 < first.active_from_m < second.active_from_m < 122.0
