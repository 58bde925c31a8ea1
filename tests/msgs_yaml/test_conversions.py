"""Stamps, headings and diagnostic values pass through messages without loss."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from msgs_yaml import conversions

ANGLES = st.floats(-100, 100)


def test_a_stage_of_fifty_milliseconds_is_exact_and_times_are_rounded_to_the_nearest_nanosecond():
    stamps = [conversions.add_seconds(10**9, 0.05 * i) - 10**9 for i in range(3)]
    assert stamps == [0, 50_000_000, 100_000_000]
    assert conversions.ns_to_s(50_000_000) == 0.05
    assert conversions.add_seconds(0, 1.6e-9) == 2


@given(ANGLES)
@example(math.pi)
@example(-math.pi)
def test_wrapping_keeps_the_direction_and_the_half_open_turn(psi):
    wrapped = conversions.wrap_angle(psi)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(psi), abs=1e-12)
    assert math.sin(wrapped) == pytest.approx(math.sin(psi), abs=1e-12)


@given(ANGLES)
def test_a_quaternion_rotates_the_x_axis_by_its_heading_and_its_negative_is_the_same(psi):
    z, w = conversions.heading_to_quaternion(psi)
    # rotation matrix of a unit quaternion about z
    x_axis = np.array([1 - 2 * z * z, 2 * z * w])
    assert np.allclose(x_axis, [math.cos(psi), math.sin(psi)], atol=1e-14)
    heading, negative = (conversions.quaternion_to_heading(s * z, s * w) for s in (1, -1))
    assert conversions.wrap_angle(heading - psi) == pytest.approx(0.0, abs=1e-13)
    assert conversions.wrap_angle(negative - heading) == pytest.approx(0.0, abs=1e-14)


def test_a_number_beyond_all_floats_is_infinite_and_those_of_numpy_are_plain():
    assert conversions.text_to_value('1' * 400) == math.inf
    assert conversions.text_to_value('-' + '1' * 400) == -math.inf
    plain = [np.float64(0.5), np.int32(3), np.bool_(True), np.str_('solved')]
    assert list(map(conversions.value_to_text, plain)) == ['0.5', '3', 'True', 'solved']


@pytest.mark.parametrize('word', ['1', '1_000', ' 2', '-1.5', '1e3', 'False', 'infinity', 'NaN'])
def test_a_word_that_reads_as_something_else_is_rejected(word):
    with pytest.raises(ValueError, match='would be read as a number or truth'):
        conversions.value_to_text(word)
