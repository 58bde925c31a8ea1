"""The share of P_k at which the step pushes as the Gaussian does."""

import numpy as np
import pytest

from bags.study import penalty, variants


def test_the_share_is_that_of_the_slopes_of_the_costs():
    depth, h = np.linspace(0.05, 0.95, 19), 1e-6

    def gaussian(D):
        return np.exp(-2 * D**2) * (D - 1) ** 2

    def step(D):
        return (D - 1) ** 2

    slopes = [cost(depth + h) - cost(depth - h) for cost in (gaussian, step)]
    assert penalty.gaussian_force_share(depth) == pytest.approx(slopes[0] / slopes[1], rel=1e-6)


def test_deep_intrusions_weigh_alike_and_shallow_ones_a_seventh():
    assert penalty.of_depths(np.array([0.0])).force_share == 1.0
    rim = penalty.of_depths(np.array([1 - 1e-9]))
    assert rim.force_share == pytest.approx(np.exp(-2))
    assert rim.cost_share == pytest.approx(np.exp(-2))


def test_equal_penalty_is_what_the_mpcc_plans_with_at_the_operating_point():
    found = penalty.planned(variants.SCENARIO, 75.0, 'mpcc')
    assert found.stages > 100
    assert found.force_share == pytest.approx(variants.EQUAL_PENALTY, rel=0.1)
