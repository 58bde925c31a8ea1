"""Headings and quaternions are two names of one turn."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msgs_yaml import yaw

ANGLES = st.floats(-100, 100)


@settings(derandomize=True, deadline=None)
@given(ANGLES)
def test_wrapping_keeps_the_direction_and_the_half_open_turn(psi):
    wrapped = yaw.wrap(psi)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(psi), abs=1e-12)
    assert math.sin(wrapped) == pytest.approx(math.sin(psi), abs=1e-12)


def test_straight_back_is_plus_pi_from_either_side():
    assert yaw.wrap(math.pi) == math.pi
    assert yaw.wrap(-math.pi) == math.pi


@settings(derandomize=True, deadline=None)
@given(ANGLES)
def test_the_quaternion_rotates_the_x_axis_by_the_heading(psi):
    z, w = yaw.to_quaternion(psi)
    # rotation matrix of a unit quaternion about z
    x_axis = np.array([1 - 2 * z * z, 2 * z * w])
    assert np.allclose(x_axis, [math.cos(psi), math.sin(psi)], atol=1e-14)


@settings(derandomize=True, deadline=None)
@given(ANGLES)
def test_a_quaternion_and_its_negative_are_one_heading(psi):
    z, w = yaw.to_quaternion(psi)
    difference = yaw.from_quaternion(-z, -w) - yaw.from_quaternion(z, w)
    assert yaw.wrap(difference) == pytest.approx(0.0, abs=1e-14)


@settings(derandomize=True, deadline=None)
@given(st.floats(-math.pi, math.pi))
def test_the_received_heading_is_within_rounding_of_the_sent_one(psi):
    assert abs(yaw.wrap(yaw.as_received(psi) - psi)) <= 1e-15
