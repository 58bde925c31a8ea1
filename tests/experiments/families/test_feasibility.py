"""The closed forms that sieve nominal draws against a point mass integrated over time."""

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from experiments.families import feasibility

STEP = 1e-3  # s
GRIP = feasibility.GRIP_SHARE * feasibility.GRAVITY
speeds, frictions = st.floats(5.0, 40.0), st.floats(0.3, 1.0)
QUICK = settings(max_examples=40)


@QUICK
@given(speed=speeds, friction=frictions)
def test_braking_distance_is_that_of_a_point_mass(speed, friction):
    v, s, t = speed, 0.0, 0.0
    while v > 0.0:
        braking = t >= feasibility.DELAY_S
        s += v * STEP
        v -= GRIP * friction * STEP * braking
        t += STEP
    assert feasibility.braking_distance(speed, friction) == pytest.approx(s, abs=2 * speed * STEP)
    assert feasibility.can_stop(speed, s + feasibility.CAR_NOSE + 0.2, friction)
    assert not feasibility.can_stop(speed, s + feasibility.CAR_NOSE - 0.2, friction)


def test_a_disc_beside_the_car_needs_no_shift():
    beside = 1.0 + feasibility.CAR_WIDTH / 2 + feasibility.CLEARANCE
    assert feasibility.shift_beside(1.0, beside) == 0.0
    assert feasibility.shift_beside(1.0, -beside + 0.3) == pytest.approx(0.3)


def closest(speed, theirs, slow, deceleration, friction):
    """Return how much smaller than at first the gap to a braking car ever gets [m]."""
    own, ahead, t, gap, least = speed, theirs, 0.0, 0.0, 0.0
    while own > slow or ahead > slow:
        gap += (ahead - own) * STEP
        least = min(least, gap)
        ahead = max(slow, ahead - deceleration * STEP)
        if t >= feasibility.DELAY_S:
            # no harder than needed: it may be slower than the one ahead
            own = max(0.0, own - GRIP * friction * STEP)
        if own <= ahead and t >= feasibility.DELAY_S:
            break
        t += STEP
    return -least


@QUICK
@given(
    speed=speeds,
    share=st.floats(0.5, 1.0),
    slow_share=st.floats(0.0, 0.9),
    deceleration=st.floats(1.0, 10.0),
)
def test_following_a_braking_car_is_possible_where_two_point_masses_do_not_meet(
    speed, share, slow_share, deceleration
):
    theirs = share * speed
    slow = slow_share * theirs
    needed = closest(speed, theirs, slow, deceleration, 1.0) + feasibility.CLEARANCE
    assume(needed > feasibility.CLEARANCE)
    given_ = (speed, theirs, slow, deceleration)
    assert feasibility.can_follow_braking(*given_, needed + 0.15, 1.0)
    assert not feasibility.can_follow_braking(*given_, needed - 0.15, 1.0)


@QUICK
@given(time=st.floats(0.2, 3.0), friction=frictions)
def test_lateral_shifts_are_those_of_a_point_mass(time, friction):
    t = max(0.0, time - feasibility.DELAY_S)
    a, half = GRIP * friction, t / 2
    assert feasibility.lateral_shift(time, friction) == pytest.approx(a * t * half)
    # to one side for half of the time, to the other for the rest: parallel at the end
    first = a * half**2 / 2
    there = first + a * half * half - a * half**2 / 2
    assert feasibility.lateral_shift_and_back(time, friction) == pytest.approx(there)
