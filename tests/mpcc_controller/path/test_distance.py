"""Distances and their priority (paper, section 3.3), against closed forms."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.path import distance
from mpcc_controller.path.distance import Circle, Disc, Edge, Edges

quick = settings(deadline=None, derandomize=True, max_examples=100)
D_SFT = 0.8


def curve(D):
    """Return the cost of a distance per P_k, and its slope and curvature."""
    symbol = ca.SX.sym('D')
    f = distance.intrusion(symbol, D_SFT)
    hessian, gradient = ca.hessian(f, symbol)
    return [float(value) for value in ca.Function('f', [symbol], [f, gradient, hessian])(D)]


@pytest.mark.parametrize(
    ('share', 'cost'),
    [(-0.5, 2.25), (0.0, 1.0), (0.2, 0.591), (0.4, 0.261), (0.6, 0.078), (0.8, 0.011), (1.0, 0.0)],
)
def test_cost_of_a_distance_has_its_closed_form(share, cost):
    assert curve(share * D_SFT)[0] == pytest.approx(cost * D_SFT**2, abs=6e-4)


def test_priority_is_full_in_contact_and_e_to_the_minus_two_at_the_safety_distance():
    assert float(distance.gaussian_priority(-0.3, D_SFT)) == 1
    assert float(distance.gaussian_priority(0.0, D_SFT)) == 1
    assert float(distance.gaussian_priority(D_SFT, D_SFT)) == pytest.approx(np.exp(-2))
    assert float(distance.gaussian_priority(1.0001 * D_SFT, D_SFT)) == 0


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


@quick
@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(0.1, 3))
def test_v2o_is_the_gap_between_two_circles(X, Y, r_obs):
    gap = distance.v2o(Circle(0.0, 0.0, 1.1), Disc(X, Y, r_obs))
    assert gap == pytest.approx(np.hypot(X, Y) - 1.1 - r_obs, abs=1.1e-3)


def test_v2o_has_a_gradient_at_the_centre_of_an_obstacle():
    X = ca.SX.sym('X')
    D = distance.v2o(Circle(X, 0.0, 1.0), Disc(0.0, 0.0, 1.0))
    assert np.isfinite(float(ca.Function('g', [X], [ca.gradient(D, X)])(0)))


@quick
@given(st.floats(-3, 3), st.floats(0, 100))
def test_both_edge_distances_fill_the_width_of_a_straight_road(Y, X):
    left, right = Edge(10.0, 6.0, 0.0, 0.0), Edge(12.0, -2.5, 0.0, 0.0)
    to_left, to_right = distance.v2e(Circle(X, Y, 1.1), Edges(left, right))
    assert to_left == pytest.approx(6.0 - Y - 1.1)
    assert to_right == pytest.approx(Y + 2.5 - 1.1)


@pytest.mark.parametrize('turn', [1, -1])
@pytest.mark.parametrize('radius', [20.0, 50.0])
def test_a_curved_edge_is_a_parabola_with_a_small_error(turn, radius):
    """Edge: a circle about the origin, touched at angle 0; the car is 1 m along and 2 m inside."""
    edge = Edge(radius, 0.0, turn * np.pi / 2, turn / radius)
    angle = turn / radius
    inside = Circle((radius - 2) * np.cos(angle), (radius - 2) * np.sin(angle), 1.0)
    assert turn * distance.lateral_offset(inside, edge) == pytest.approx(
        2.0, abs=1.2 * 2 / radius**2 / 2
    )


def test_circles_sit_on_the_body_axis():
    class Pose:
        X, Y, psi = 1.0, 2.0, np.pi / 2

    front = distance.circle(Pose, 1.5, 1.0)
    assert pytest.approx((1.0, 3.5)) == (front.X, front.Y)
