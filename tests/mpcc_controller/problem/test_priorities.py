"""Priority and cost of a distance (paper, section 3.3), against closed forms."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.problem import priorities

quick = settings(max_examples=100)
D_SFT = 0.8
D_STEP = 0.5


def curve(D):
    """Return the cost of a distance per P_k, and its slope and curvature."""
    symbol = ca.SX.sym('D')
    f = priorities.intrusion(symbol, D_SFT)
    hessian, gradient = ca.hessian(f, symbol)
    return [float(value) for value in ca.Function('f', [symbol], [f, gradient, hessian])(D)]


@pytest.mark.parametrize(
    ('share', 'cost'),
    [(-0.5, 2.25), (0.0, 1.0), (0.2, 0.591), (0.4, 0.261), (0.6, 0.078), (0.8, 0.011), (1.0, 0.0)],
)
def test_cost_of_a_distance_has_its_closed_form(share, cost):
    assert curve(share * D_SFT)[0] == pytest.approx(cost * D_SFT**2, abs=6e-4)


def test_priority_is_full_in_contact_and_e_to_the_minus_two_at_the_safety_distance():
    assert float(priorities.gaussian_priority(-0.3, D_SFT)) == 1
    assert float(priorities.gaussian_priority(0.0, D_SFT)) == 1
    assert float(priorities.gaussian_priority(D_SFT, D_SFT)) == pytest.approx(np.exp(-2))
    assert float(priorities.gaussian_priority(1.0001 * D_SFT, D_SFT)) == 0


@pytest.mark.parametrize('corner', [0.0, D_SFT])
def test_cost_of_a_distance_has_no_corner(corner):
    before, after = curve(corner - 1e-7), curve(corner + 1e-7)
    assert before[0] == pytest.approx(after[0], abs=1e-6)
    assert before[1] == pytest.approx(after[1], abs=1e-5)


@quick
@given(st.floats(-2, 3), st.floats(1e-3, 1))
def test_nearer_never_costs_less(D, step):
    assert curve(D)[0] >= curve(D + step)[0]


def test_far_obstacles_cost_nothing_and_have_no_gradient():
    assert curve(1e4) == [0, 0, 0]


def test_the_step_doubles_the_cost_of_contact_and_leaves_the_rest_quadratic():
    D = np.array([-0.5, -0.1, 0.1, 0.3, D_STEP, 0.6])
    costs = [float(priorities.intrusion(d, D_STEP, priorities.step_priority)) for d in D]
    factor = np.array([2, 2, 1, 1, 1, 0])
    assert costs == pytest.approx(factor * (D - D_STEP) ** 2, rel=1e-3)


def test_the_step_is_blended_over_centimetres_without_a_jump_or_a_dip():
    symbol = ca.SX.sym('D')
    cost = priorities.intrusion(symbol, D_STEP, priorities.step_priority)
    f = ca.Function('f', [symbol], [cost, ca.gradient(cost, symbol)])
    D = np.linspace(-1.0, D_STEP, 3001)
    values, slopes = (row.full().ravel() for row in f(ca.DM(D).T))
    assert np.all(np.diff(values) < 0)
    assert np.abs(np.diff(values)).max() < 0.01
    assert np.gradient(values, D)[1:-1] == pytest.approx(slopes[1:-1], abs=0.02)
    risen = [float(priorities.step_priority(d, D_STEP)) for d in (0.04, -0.04)]
    assert risen == pytest.approx([1.0, 2.0], abs=0.02)


def test_an_intrusion_costs_at_least_as_much_with_the_step_as_with_the_gaussian():
    for D in np.linspace(-0.3, D_STEP, 40):
        gaussian = float(priorities.intrusion(D, D_STEP))
        assert float(priorities.intrusion(D, D_STEP, priorities.step_priority)) >= gaussian
