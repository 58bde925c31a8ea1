import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenario_publisher import curves

everywhere = settings(deadline=None, derandomize=True, max_examples=60)
lengths = st.floats(5.0, 300.0)
curvatures = st.floats(-0.1, 0.1)
shares = st.floats(-0.7, 0.7)


def ends(curve):
    return np.array([0.0, curve.length])


def slope(function, s, step):
    return (function(s + step) - function(s - step)) / (2 * step)


@everywhere
@given(length=lengths, kappa_0=curvatures, kappa_1=curvatures)
def test_clothoid_has_the_curvatures_asked_for_at_its_ends(length, kappa_0, kappa_1):
    curve = curves.clothoid(length, kappa_0, kappa_1)
    assert curve.kappa(ends(curve)) == pytest.approx([kappa_0, kappa_1], abs=1e-12)


@everywhere
@given(advance=lengths, share=shares)
def test_lane_change_starts_and_ends_straight_and_without_curvature(advance, share):
    curve = curves.lane_change(advance, share * advance)
    assert curve.kappa(ends(curve)) == pytest.approx([0.0, 0.0], abs=1e-12)
    assert curve.turn(ends(curve)) == pytest.approx([0.0, 0.0], abs=1e-12)


@everywhere
@given(advance=lengths, share=shares)
def test_curvature_of_a_lane_change_is_the_slope_of_its_heading(advance, share):
    curve = curves.lane_change(advance, share * advance)
    s = np.linspace(0.1, 0.9, 9) * curve.length
    found = slope(curve.turn, s, 1e-4 * curve.length)
    assert found == pytest.approx(curve.kappa(s), abs=1e-6)


@everywhere
@given(length=lengths, kappa_0=curvatures, kappa_1=curvatures)
def test_curvature_of_a_clothoid_is_the_slope_of_its_heading(length, kappa_0, kappa_1):
    curve = curves.clothoid(length, kappa_0, kappa_1)
    s = np.linspace(0.1, 0.9, 9) * length
    assert slope(curve.turn, s, 1e-4 * length) == pytest.approx(curve.kappa(s), abs=1e-8)


@everywhere
@given(advance=lengths, share=shares)
def test_mirrored_lane_change_has_the_opposite_heading_and_the_same_length(advance, share):
    left = curves.lane_change(advance, share * advance)
    right = curves.lane_change(advance, -share * advance)
    s = np.linspace(0.0, left.length, 11)
    assert right.length == pytest.approx(left.length, rel=1e-12)
    assert right.turn(s) == pytest.approx(-left.turn(s), abs=1e-10)


def test_gentle_lane_change_is_the_quintic_of_least_jerk():
    advance, offset = 200.0, 1.0
    curve = curves.lane_change(advance, offset)
    q = np.linspace(0.0, 1.0, 21)
    quintic = offset / advance**2 * (60 * q - 180 * q**2 + 120 * q**3)
    assert curve.kappa(q * curve.length) == pytest.approx(quintic, abs=2e-4 * quintic.max())


def test_lane_change_of_no_offset_is_straight():
    curve = curves.lane_change(30.0, 0.0)
    assert curve.length == pytest.approx(30.0, rel=1e-14)
    assert curve.kappa(np.linspace(0, 30, 7)) == pytest.approx(np.zeros(7), abs=1e-14)


def test_lane_change_that_would_drive_across_is_refused_with_what_is_allowed():
    with pytest.raises(ValueError, match=r'moves 40 m aside within 30 m; allowed at most [\d.]+ m'):
        curves.lane_change(30.0, 40.0)
