"""After an internal error: a valid command whatever is known, and the error is counted."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.driving import last_resort
from mpcc_controller.driving.gate import Gate
from mpcc_controller.driving.last_resort import InternalErrors
from msgs_yaml.types import Command, VehicleState

STEP_S = 0.05
LINE = np.array([[0.0, 0.0], [50.0, 0.0], [50.0, 0.0], [80.0, 4.0]])
X = VehicleState(1, 20.0, 1.0, 0.0, 20.0, 0.0, 0.0)
number = st.floats(-1e3, 1e3)
unknown = st.one_of(number, st.just(math.nan), st.just(math.inf))


@pytest.fixture(scope='module')
def brake(params, car):
    def command(x, last, line, car=car):
        rules = params.limits, params.braking, STEP_S
        return last_resort.braking_command(x, last, line, car, *rules)

    return command


@settings(max_examples=300)
@given(
    x=st.builds(VehicleState, st.just(1), *[unknown] * 2, *[st.one_of(number, unknown)] * 4),
    delta=st.floats(-0.471, 0.471),
    force=st.floats(-12000.0, 6000.0),
    line=st.sampled_from([None, LINE[:1], LINE[1:3], LINE]),
    friction=st.floats(0.05, 1.0),
)
def test_the_command_passes_the_gate_whatever_the_state_is(
    brake, car, params, x, delta, force, line, friction
):
    car = car._replace(mu_f=0.88 * friction, mu_r=0.92 * friction)
    braking = min(force, 0.0)
    last = Command(0, delta, 0.0, 0.6 * braking, force - 0.6 * braking)
    command = brake(x, last, line, car)
    gate = Gate(params.limits, car, STEP_S, 0.2)
    # what the last command asks of an axle beyond its friction takes time to release
    if gate.check(last._replace(stamp_ns=1), last, 0.0, car).reason == '':
        assert gate.check(command, last, 0.0, car).reason == ''
    assert all(math.isfinite(value) for value in command)
    assert command.Fxf + command.Fxr <= max(force, 0.0)


def test_it_steers_back_to_the_line_and_brakes_with_what_friction_is_left(brake):
    last = Command(0, 0.0, 0.0, -8000.0, -6000.0)
    right, left, straight = (brake(X._replace(Y=Y), last, LINE) for Y in (1.0, -1.0, 0.0))
    assert right.delta == pytest.approx(-left.delta) != 0
    assert right.delta < straight.delta == 0.0
    assert straight.Fxf + straight.Fxr < right.Fxf + right.Fxr < 0
    assert straight.Fxf / (straight.Fxf + straight.Fxr) > 0.6  # of the loads while braking


@pytest.mark.parametrize(('x', 'line'), [(X, None), (X._replace(vx=math.nan), LINE)])
def test_without_line_or_state_it_holds_the_angle_and_leaves_friction_for_a_bend(
    brake, car, x, line
):
    command = brake(x, Command(0, 0.1, 0.0, -4000.0, -3000.0), line)
    assert (command.delta, command.d_delta) == (0.1, 0.0)
    assert -0.5 * car.m * 9.81 < command.Fxf + command.Fxr < -0.3 * car.m * 9.81


def test_a_slow_car_steers_along_the_arc_whatever_its_slip_angles_are(brake):
    last = Command(0, 0.0, 0.0, -4000.0, -3000.0)
    slow = X._replace(vx=2.0)
    deltas = [brake(slow._replace(r=r), last, LINE).delta for r in (0.0, 0.5)]
    assert deltas[0] == deltas[1]
    assert -0.05 < deltas[0] < 0.0  # 2 m/s need little


def test_a_line_without_length_and_a_car_that_drives_are_braked_straight(brake, params):
    last = Command(0, 0.0, 0.0, 0.0, 3000.0)
    command = brake(X._replace(Y=0.0), last, np.array([[5.0, 0.0], [5.0, 0.0]]))
    assert command.delta == 0.0
    # the driving force is released at its rate, by the axle that drives
    assert (command.Fxf, command.Fxr) == (0.0, 3000.0 - params.limits.force_rate_nps * STEP_S)


def test_errors_are_counted_by_type_and_line_and_each_kind_is_logged_once():
    def fail():
        raise ValueError('once')

    def fail_deeper():
        fail()

    def fail_elsewhere():
        raise ValueError('once')

    errors = InternalErrors()
    for function in (fail, fail_deeper, fail, fail_elsewhere):
        with pytest.raises(ValueError) as caught:  # noqa: PT011
            function()
        errors.add(caught.value)
    first, second = errors.take_new()
    assert first.startswith('ValueError in test_last_resort.py, line ')
    assert first.endswith(', fail: once')
    assert second.endswith(', fail_elsewhere: once')
    assert list(errors.counts.values()) == [3, 1]
    assert errors.latest == second
    errors.add(caught.value)
    assert errors.take_new() == []
    errors.add(ValueError('never raised'))
    assert errors.latest == 'ValueError: never raised'
