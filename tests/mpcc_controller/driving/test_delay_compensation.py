"""The state when the command takes hold, under what the actuators have been told."""

import numpy as np
import pytest

from mpcc_controller.driving import delay_compensation
from mpcc_controller.driving.delay_compensation import (
    LatencyEstimator,
    SetpointRamp,
    StatePredictor,
)
from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.parameters import Delay
from mpcc_controller.problem import stage_parameters

MS = 1_000_000
REST = delay_compensation.constant_ramp(Setpoints(0.0, 0.0), 0.6)


@pytest.fixture(scope='module')
def car(params, vehicle):
    return stage_parameters.car(params, vehicle)


@pytest.fixture(scope='module')
def ahead(car):
    return StatePredictor(car)


def test_without_a_delay_the_state_stays_as_it_is(ahead, world):
    x = world.rolling(r=0.1, stamp_ns=7)
    assert ahead.predict(x, REST, 7) is x


def test_the_motion_is_that_of_the_model_with_its_set_points_held(ahead, car, world):
    x = world.rolling(stamp_ns=7, r=0.2, vy=-0.1)
    moved = ahead.predict(
        x, delay_compensation.constant_ramp(Setpoints(0.05, -4000.0), 0.6), 7 + 10 * MS
    )
    assert moved.stamp_ns == 7 + 10 * MS
    assert pytest.approx(0.2, abs=1e-3) == moved.X
    assert moved.psi == pytest.approx(0.002, abs=1e-4)
    braking = (-4000.0 - car.drag * 400 - car.rolling) / car.m
    assert moved.vx - x.vx == pytest.approx(0.01 * braking, rel=0.2)
    assert moved.r > x.r


def test_the_actuators_move_to_their_set_points_on_the_way(ahead, car, world):
    """The change of speed is the integral of a force that first ramps and then holds."""
    x = world.rolling(stamp_ns=0)
    told = SetpointRamp(-30 * MS, Setpoints(0.0, 0.0), 20 * MS, Setpoints(0.0, -5000.0), 0.6)
    moved = ahead.predict(x, told, 40 * MS)
    impulse = -(3000.0 + 5000.0) / 2 * 0.02 - 5000.0 * 0.02
    drag = -(car.drag * 400 + car.rolling) * 0.04
    assert moved.vx - x.vx == pytest.approx((impulse + drag) / car.m, rel=0.02)


def test_set_points_that_jump_are_held_before_and_after(ahead, world):
    """A first step of 50 ms or more: its command is due when it takes hold."""
    x = world.rolling(stamp_ns=0, r=0.1)
    before, after = Setpoints(0.0, 0.0), Setpoints(0.05, -5000.0)
    halfway = ahead.predict(x, delay_compensation.constant_ramp(before, 0.6), 20 * MS)
    wanted = ahead.predict(halfway, delay_compensation.constant_ramp(after, 0.6), 40 * MS)
    assert ahead.predict(x, SetpointRamp(20 * MS, before, 20 * MS, after, 0.6), 40 * MS) == wanted


def test_steps_are_short_enough(ahead, world):
    """Twice over half the time equals once over all of it."""
    x = world.rolling(stamp_ns=0, vy=0.3, r=-0.4)
    told = delay_compensation.constant_ramp(Setpoints(0.1, -6000.0), 0.6)
    half = ahead.predict(ahead.predict(x, told, 25 * MS), told, 50 * MS)
    assert np.allclose(half, ahead.predict(x, told, 50 * MS), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(
    ('ms', 'delta', 'Fx'),
    [(-10, 0.1, 100.0), (0, 0.1, 100.0), (25, 0.2, -50.0), (50, 0.3, -200.0), (80, 0.3, -200.0)],
)
def test_set_points_move_straight_and_stay_where_they_were_told(ms, delta, Fx):
    told = SetpointRamp(0, Setpoints(0.1, 100.0), 50 * MS, Setpoints(0.3, -200.0), 0.6)
    assert told.at(ms * MS) == pytest.approx((delta, Fx))


def test_a_ramp_without_duration_is_at_its_end():
    assert SetpointRamp(5, Setpoints(0.1, 1.0), 5, Setpoints(0.2, 2.0), 0.6).at(5) == (0.2, 2.0)


def test_time_is_cut_where_the_rates_change():
    told = SetpointRamp(10 * MS, Setpoints(0.0, 0.0), 30 * MS, Setpoints(0.2, 0.0), 0.6)
    cut = delay_compensation.split_ramp(told, 0, 40 * MS)
    assert [piece.duration_s for piece in cut] == pytest.approx([0.01, 0.02, 0.01])
    assert [piece.begin.delta for piece in cut] == [0.0, 0.0, 0.2]
    assert [piece.end.delta for piece in cut] == [0.0, 0.2, 0.2]
    (whole,) = delay_compensation.split_ramp(told, 30 * MS, 40 * MS)
    assert whole.duration_s == pytest.approx(0.01)


RULES = Delay(computing_s=0.01, transport_s=0.001, longest_s=0.05)


def test_the_delay_is_the_age_and_the_computing_time_and_the_way_to_the_actuators():
    expected = LatencyEstimator(RULES)
    assert expected.estimate(0.002) == pytest.approx(0.002 + 0.01 + 0.001)
    for took in (0.004, 0.003, 0.1):  # one that was interrupted says nothing about the next
        expected.add(took)
    assert expected.estimate(0.0) == pytest.approx(0.004 + 0.001)
    for _ in range(20):
        expected.add(0.02)
    assert expected.estimate(0.0) == pytest.approx(0.021)


def test_the_delay_stays_within_a_tick_and_never_lies_in_the_past():
    assert LatencyEstimator(RULES).estimate(0.2) == 0.05
    assert LatencyEstimator(RULES).estimate(-1.0) == 0.0


HERE, THERE = Setpoints(0.0, 0.0), Setpoints(0.1, -1000.0)


def test_pieces_meet_where_the_ramp_begins_and_ends():
    ramp = SetpointRamp(10 * MS, HERE, 30 * MS, THERE, 0.6)
    found = delay_compensation.split_ramp(ramp, 0, 50 * MS)
    assert [one.duration_s for one in found] == pytest.approx([0.01, 0.02, 0.02])
    assert [one.begin for one in found] == [HERE, HERE, THERE]
    assert [one.end for one in found] == [HERE, THERE, THERE]


def test_a_command_that_was_due_at_once_has_no_piece_without_length():
    step = SetpointRamp(20 * MS, HERE, 20 * MS, THERE, 0.6)
    found = delay_compensation.split_ramp(step, 0, 50 * MS)
    assert [one.duration_s for one in found] == pytest.approx([0.02, 0.03])
    assert found[-1].end == THERE
