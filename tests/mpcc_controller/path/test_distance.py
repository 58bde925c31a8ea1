"""Distances to obstacles and road edges (paper, section 3.3), against closed forms."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.path import distance
from mpcc_controller.path.distance import Circle, Disc, Edge, Edges

quick = settings(max_examples=100)


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
