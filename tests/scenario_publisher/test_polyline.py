import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenario_publisher import polyline

everywhere = settings(max_examples=60)
CORNER = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
angles = np.linspace(0.0, 2 * np.pi, 91)
CIRCLE = 20.0 * np.column_stack([np.cos(angles), np.sin(angles)])


def test_refined_polyline_keeps_its_corners_and_shape():
    fine = polyline.refine(CORNER, 0.3)
    assert polyline.steps(fine).max() <= 0.3 + 1e-12
    assert polyline.steps(fine).sum() == pytest.approx(20.0)
    for corner in CORNER:
        assert np.min(np.hypot(*(fine - corner).T)) < 1e-12


def test_turns_are_right_angles_at_a_square_corner_and_half_a_turn_on_the_way_back():
    assert polyline.turns(CORNER) == pytest.approx([np.pi / 2])
    assert polyline.turns(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]])) == pytest.approx([np.pi])


@everywhere
@given(radius=st.floats(15.0, 25.0), angle=st.floats(-np.pi, np.pi))
def test_inside_of_a_circle_driven_to_the_left_is_left_of_it(radius, angle):
    X, Y = radius * np.cos(angle), radius * np.sin(angle)
    assert polyline.left_of(CIRCLE, X, Y) == pytest.approx([20.0 - radius], abs=0.03)


@everywhere
@given(x=st.floats(0.0, 9.0), y=st.floats(-5.0, 1.0))
def test_reversed_polyline_sees_the_other_side(x, y):
    fine = polyline.refine(CORNER, 0.5)
    there, back = polyline.left_of(fine, x, y), polyline.left_of(fine[::-1], x, y)
    assert there == pytest.approx(-back, abs=1e-12)
    assert there == pytest.approx([y], abs=1e-12)


def test_side_is_known_at_a_sharp_corner():
    fine = polyline.refine(CORNER, 0.5)
    X, Y = np.array([11.0, 9.0, 10.5]), np.array([-1.0, 1.0, -0.01])
    assert np.sign(polyline.left_of(fine, X, Y)).tolist() == [-1.0, 1.0, -1.0]


def test_overrun_counts_only_what_lies_before_the_start_or_behind_the_end():
    fine = polyline.refine(CORNER, 0.5)
    X, Y = np.array([-2.0, 5.0, 10.0, 10.5]), np.array([0.3, 3.0, 13.0, 9.0])
    assert polyline.overrun(fine, X, Y) == pytest.approx([2.0, 0.0, 3.0, 0.0])


def test_nothing_runs_over_the_end_of_a_closed_lap():
    overrun = polyline.overrun(CIRCLE, *(0.9 * CIRCLE.T))
    assert overrun.max() < polyline.steps(CIRCLE).max()
