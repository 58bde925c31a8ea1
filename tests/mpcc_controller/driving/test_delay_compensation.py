"""The state at which a command takes effect, predicted with the setpoints already sent."""

import numpy as np
import pytest

from mpcc_controller.driving import delay_compensation
from mpcc_controller.driving.delay_compensation import (
    SetpointRamp,
    expected_delay,
)
from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.parameters import Delay

MS = 1_000_000
REST = delay_compensation.constant_ramp(Setpoints(0.0, 0.0), 0.6)


@pytest.fixture(scope='module')
def predictor(car):
    return Predictor(car)


class Predictor:
    """Predicts the motion of a car."""

    def __init__(self, car):
        self.car = car

    def predict(self, x, ramps, stamp_ns):
        return delay_compensation.predict(x, ramps, stamp_ns, self.car)


def test_without_a_delay_the_state_stays_as_it_is(predictor, world):
    x = world.rolling(r=0.1, stamp_ns=7)
    assert predictor.predict(x, [REST], 7) is x


def test_the_motion_is_that_of_the_model_with_its_setpoints_held(predictor, car, world):
    x = world.rolling(stamp_ns=7, r=0.2, vy=-0.1)
    moved = predictor.predict(
        x, [delay_compensation.constant_ramp(Setpoints(0.05, -4000.0), 0.6)], 7 + 10 * MS
    )
    assert moved.stamp_ns == 7 + 10 * MS
    assert pytest.approx(0.2, abs=1e-3) == moved.X
    assert moved.psi == pytest.approx(0.002, abs=1e-4)
    braking = (-4000.0 - car.drag * 400 - car.rolling) / car.m
    assert moved.vx - x.vx == pytest.approx(0.01 * braking, rel=0.2)
    assert moved.r > x.r


def test_the_actuators_move_to_their_setpoints_during_the_prediction(predictor, car, world):
    """The change of speed is the integral of a force that first ramps and then holds."""
    x = world.rolling(stamp_ns=0)
    ramp = SetpointRamp(-30 * MS, Setpoints(0.0, 0.0), 20 * MS, Setpoints(0.0, -5000.0), 0.6)
    moved = predictor.predict(x, [ramp], 40 * MS)
    impulse = -(3000.0 + 5000.0) / 2 * 0.02 - 5000.0 * 0.02
    drag = -(car.drag * 400 + car.rolling) * 0.04
    assert moved.vx - x.vx == pytest.approx((impulse + drag) / car.m, rel=0.02)


def test_setpoints_that_jump_are_held_before_and_after(predictor, world):
    """A first step of 50 ms or more: its command is due when it takes effect."""
    x = world.rolling(stamp_ns=0, r=0.1)
    before, after = Setpoints(0.0, 0.0), Setpoints(0.05, -5000.0)
    halfway = predictor.predict(x, [delay_compensation.constant_ramp(before, 0.6)], 20 * MS)
    wanted = predictor.predict(halfway, [delay_compensation.constant_ramp(after, 0.6)], 40 * MS)
    ramp = SetpointRamp(20 * MS, before, 20 * MS, after, 0.6)
    assert predictor.predict(x, [ramp], 40 * MS) == wanted


def test_steps_are_short_enough(predictor, world):
    """Twice over half the time equals once over all of it."""
    x = world.rolling(stamp_ns=0, vy=0.3, r=-0.4)
    ramp = delay_compensation.constant_ramp(Setpoints(0.1, -6000.0), 0.6)
    half = predictor.predict(predictor.predict(x, [ramp], 25 * MS), [ramp], 50 * MS)
    assert np.allclose(half, predictor.predict(x, [ramp], 50 * MS), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(
    ('ms', 'delta', 'Fx'),
    [(-10, 0.1, 100.0), (0, 0.1, 100.0), (25, 0.2, -50.0), (50, 0.3, -200.0), (80, 0.3, -200.0)],
)
def test_setpoints_change_linearly_and_are_held_outside_the_ramp(ms, delta, Fx):
    ramp = SetpointRamp(0, Setpoints(0.1, 100.0), 50 * MS, Setpoints(0.3, -200.0), 0.6)
    assert ramp.at(ms * MS) == pytest.approx((delta, Fx))


def test_a_ramp_without_duration_is_at_its_end():
    assert SetpointRamp(5, Setpoints(0.1, 1.0), 5, Setpoints(0.2, 2.0), 0.6).at(5) == (0.2, 2.0)


def test_time_is_cut_where_the_rates_change():
    ramp = SetpointRamp(10 * MS, Setpoints(0.0, 0.0), 30 * MS, Setpoints(0.2, 0.0), 0.6)
    cut = delay_compensation.split_ramp(ramp, 0, 40 * MS)
    assert [piece.duration_s for piece in cut] == pytest.approx([0.01, 0.02, 0.01])
    assert [piece.begin.delta for piece in cut] == [0.0, 0.0, 0.2]
    assert [piece.end.delta for piece in cut] == [0.0, 0.2, 0.2]
    (whole,) = delay_compensation.split_ramp(ramp, 30 * MS, 40 * MS)
    assert whole.duration_s == pytest.approx(0.01)


RULES = Delay(computing_s=0.01, transport_s=0.001, longest_s=0.05, command_s=None)


def test_the_delay_is_the_sum_of_age_computing_time_and_transport_time():
    assert expected_delay((), 0.002, RULES) == pytest.approx(0.002 + 0.01 + 0.001)
    # an interrupted solve does not change the estimate
    assert expected_delay((0.004, 0.003, 0.1), 0.0, RULES) == pytest.approx(0.004 + 0.001)


def test_the_delay_is_at_most_a_tick_and_never_negative():
    assert expected_delay((), 0.2, RULES) == 0.05
    assert expected_delay((), -1.0, RULES) == 0.0


HERE, THERE = Setpoints(0.0, 0.0), Setpoints(0.1, -1000.0)


def test_pieces_meet_where_the_ramp_begins_and_ends():
    ramp = SetpointRamp(10 * MS, HERE, 30 * MS, THERE, 0.6)
    pieces = delay_compensation.split_ramp(ramp, 0, 50 * MS)
    assert [piece.duration_s for piece in pieces] == pytest.approx([0.01, 0.02, 0.02])
    assert [piece.begin for piece in pieces] == [HERE, HERE, THERE]
    assert [piece.end for piece in pieces] == [HERE, THERE, THERE]


def test_a_step_of_the_setpoints_has_no_piece_without_length():
    step = SetpointRamp(20 * MS, HERE, 20 * MS, THERE, 0.6)
    pieces = delay_compensation.split_ramp(step, 0, 50 * MS)
    assert [piece.duration_s for piece in pieces] == pytest.approx([0.02, 0.03])
    assert pieces[-1].end == THERE
