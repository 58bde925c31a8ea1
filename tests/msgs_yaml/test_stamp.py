"""Time is one whole number of nanoseconds; nothing is lost on the way to ROS and back."""

from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msgs_yaml import stamp


@settings(derandomize=True, deadline=None)
@given(st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1))
def test_splitting_and_joining_a_stamp_is_the_identity(stamp_ns):
    sec, nanosec = stamp.split(stamp_ns)
    assert 0 <= nanosec < 10**9
    assert stamp.to_ns(SimpleNamespace(sec=sec, nanosec=nanosec)) == stamp_ns


def test_a_stage_of_fifty_milliseconds_is_exact():
    assert [stamp.later(10**9, 0.05 * i) - 10**9 for i in range(3)] == [0, 50_000_000, 100_000_000]
    assert stamp.seconds(50_000_000) == 0.05


def test_times_are_rounded_to_the_nearest_nanosecond():
    assert stamp.later(0, 1.6e-9) == 2
    assert stamp.later(0, pytest.approx(1.0).expected) == 10**9
