"""Commands that cannot be meant do not reach the servos."""

import dataclasses
import math

import pytest

from msgs_yaml.types import Command
from vehicle_plant import stepping
from vehicle_plant.gate import OLDEST_TICKS, Gate, axle_friction
from vehicle_plant.initial_state import Start
from vehicle_plant.simulator import START_NS, TICK_NS, TICK_STEPS, Simulator
from vehicle_plant.state import SetPoints

HELD = SetPoints(0.1, -4000.0, -3000.0)
GOOD = Command(START_NS + TICK_NS, 0.11, 0.2, -4500.0, -3300.0)
OVER, UNDER = 1 + 1e-9, 1 - 1e-9
MS = 1_000_000


@pytest.fixture
def car(params):
    return Simulator(params, 1.0, Start(0.0, 0.0, 0.0, 20.0))


def good(stamp_ns=START_NS):
    return Command(stamp_ns, 0.01, 0.2, -500.0, -300.0)


@pytest.fixture
def gate(params):
    return Gate(params, 1.0, HELD, START_NS)


def check(gate, now_ns=START_NS + TICK_NS, **change):
    return gate.check(GOOD._replace(**change), now_ns, TICK_NS)


@pytest.fixture
def wide(params):
    """Return a gate with these set-points behind it whose rates allow everything at once."""

    def make(held=HELD, friction=1.0, friction_use=1.5):
        rules = dataclasses.replace(
            params.car.gate, steer_rate_radps=100.0, force_rate_nps=1e7, friction_use=friction_use
        )
        car = dataclasses.replace(params.car, gate=rules)
        return Gate(dataclasses.replace(params, car=car), friction, held, START_NS)

    return make


def test_a_command_that_can_be_meant_passes(gate):
    assert check(gate) == (True, '')
    assert gate.rejected == 0
    assert not gate.rejections
    assert gate.last_reason == ''


@pytest.mark.parametrize(
    ('change', 'code', 'reason'),
    [
        ({'delta': math.nan}, 'not_finite', 'a value is not finite'),
        ({'d_delta': math.inf}, 'not_finite', 'a value is not finite'),
        ({'Fxf': -math.inf}, 'not_finite', 'a value is not finite'),
        ({'Fxr': math.nan}, 'not_finite', 'a value is not finite'),
        ({'stamp_ns': START_NS + TICK_NS + 1}, 'from_future', 'the stamp lies in the future'),
        (
            {'stamp_ns': START_NS - 1},
            'out_of_order',
            'the stamp is older than that of the last command',
        ),
        ({'delta': 0.6}, 'out_of_range', 'steer is 0.6 rad, allowed -0.49 to 0.49'),
        ({'delta': -0.6}, 'out_of_range', 'steer is -0.6 rad, allowed -0.49 to 0.49'),
        ({'delta': 0.3}, 'too_fast', 'steer step is 0.19 rad, allowed -0.15 to 0.15'),
        ({'delta': -0.1}, 'too_fast', 'steer step is -0.2 rad, allowed -0.15 to 0.15'),
        ({'Fxf': 3000.0}, 'out_of_range', 'front_axle is 3000 N, allowed -16500 to 500'),
        ({'Fxf': -17e3}, 'out_of_range', 'front_axle is -17000 N, allowed -16500 to 500'),
        ({'Fxr': -40e3}, 'out_of_range', 'rear_axle is -40000 N, allowed -12500 to 7500'),
        ({'Fxr': 8e3}, 'out_of_range', 'rear_axle is 8000 N, allowed -12500 to 7500'),
    ],
)
def test_a_command_that_cannot_be_meant_is_refused_for_its_reason(gate, change, code, reason):
    if code == 'too_fast':  # the step is that from 0.1 rad, or from 0.11 rad after a command
        assert check(gate, START_NS + TICK_NS, delta=0.11 if change['delta'] > 0 else 0.1).accepted
    verdict = check(gate, **change)
    assert verdict == (False, reason)
    assert gate.rejections == {code: 1}
    assert gate.rejected == 1
    assert gate.last_reason == reason


@pytest.mark.parametrize(
    ('axle', 'reason'),
    [
        ('Fxf', 'front_axle step is -10001 N, allowed -10000 to 10000'),
        ('Fxr', 'rear_axle step is -10001 N, allowed -10000 to 10000'),
    ],
)
def test_each_axle_may_change_its_force_at_the_greatest_rate(params, axle, reason):
    rules = dataclasses.replace(params.car.gate, force_rate_nps=2e5)
    slow = dataclasses.replace(params, car=dataclasses.replace(params.car, gate=rules))
    resting = SetPoints(0.1, 0.0, 0.0)
    still = {'Fxf': 0.0, 'Fxr': 0.0}
    assert check(Gate(slow, 1.0, resting, START_NS), **still | {axle: -10000.0}).accepted
    slow_gate = Gate(slow, 1.0, resting, START_NS)
    assert check(slow_gate, **still | {axle: -10001.0}) == (False, reason)
    both = SetPoints(0.1, -8000.0, -8000.0)
    assert check(Gate(slow, 1.0, both, START_NS), Fxf=-8000.0, Fxr=-8000.0).accepted
    pressed = SetPoints(0.1, *((-10001.0, 0.0) if axle == 'Fxf' else (0.0, -10001.0)))
    assert not check(Gate(slow, 1.0, pressed, START_NS), **still).accepted


@pytest.mark.parametrize('sign', [1, -1])
def test_the_rates_count_over_the_time_since_the_last_command_at_least_a_tick(gate, sign):
    per_tick, per_two_ticks = 3.0 * 0.05, 3.0 * 0.1  # rad
    now_ns = START_NS + 2 * TICK_NS
    for ticks, turn in ((0, per_tick), (1, per_tick), (2, per_two_ticks)):
        stamp_ns = START_NS + ticks * TICK_NS
        inside, beyond = 0.1 + sign * turn * UNDER, 0.1 + sign * turn * (1 + 1e-6)
        assert not check(gate, now_ns, stamp_ns=stamp_ns, delta=beyond).accepted
        assert check(gate, now_ns, stamp_ns=stamp_ns, delta=inside).accepted
        gate._last, gate._stamp_ns = HELD, START_NS


def test_a_command_with_the_stamp_of_the_last_one_may_come_again(gate):
    assert check(gate).accepted
    assert check(gate).accepted
    assert not check(gate, stamp_ns=START_NS + TICK_NS - 1).accepted


def test_a_command_is_too_old_when_it_is_held_no_longer(gate):
    assert OLDEST_TICKS == 1 + stepping.HELD_TICKS
    oldest = GOOD.stamp_ns + OLDEST_TICKS * TICK_NS
    assert check(gate, oldest + 1) == (False, 'the command is 0.15 s old')
    assert gate.rejections == {'too_old': 1}
    assert check(gate, oldest).accepted


def test_ages_and_times_between_commands_are_differences_whatever_the_stamps(params):
    """Also right after time began, when a stamp is a divisor of the next one."""
    command = GOOD._replace(stamp_ns=TICK_NS)
    gate = Gate(params, 1.0, HELD, 0)
    assert not gate.check(command, 8 * TICK_NS, TICK_NS).accepted
    assert gate.check(command, 2 * TICK_NS, TICK_NS).accepted
    far = command._replace(stamp_ns=5 * TICK_NS, delta=0.11 + 0.3)  # 2 ticks' worth of turning
    assert gate.check(far, 5 * TICK_NS, TICK_NS).accepted


def test_the_limits_of_range_themselves_pass(params, wide):
    front, rear = params.car.force.front, params.car.force.rear
    gate = wide(friction_use=10.0)
    assert check(gate, delta=params.car.steering.limit_rad + 0.01).accepted
    assert check(gate, delta=-params.car.steering.limit_rad - 0.01).accepted
    assert check(gate, Fxf=-front.brake_n - 500).accepted
    assert check(gate, Fxf=front.drive_n + 500).accepted
    assert check(gate, Fxr=-rear.brake_n - 500).accepted
    assert check(gate, Fxr=rear.drive_n + 500).accepted


@pytest.mark.parametrize(
    ('axle', 'sign'), [('Fxf', -1), ('Fxr', -1), ('Fxr', 1)], ids=['front', 'rear', 'drive']
)
@pytest.mark.parametrize('friction', [0.3, 1.0, 1.2])
def test_more_than_half_as_much_again_as_the_tyres_hold_is_refused(wide, axle, sign, friction):
    """On a slippery road, too, an axle may be asked for what locks it on a good one."""
    use = 0.5
    gate = wide(SetPoints(0.1, 0.0, 0.0), friction, friction_use=use)
    names = {'Fxf': 0, 'Fxr': 1}
    force = 4000.0  # by fixed-point iteration: the limit depends on the force itself
    for _ in range(60):
        held = axle_friction(sign * force, gate._params, max(friction, 1.0))
        force = use * held[names[axle]]
    still = {'Fxf': 0.0, 'Fxr': 0.0}
    assert check(gate, **still | {axle: sign * force * (1 - 1e-6)}).accepted
    verdict = check(gate, **still | {axle: sign * force * (1 + 1e-6)})
    assert not verdict.accepted
    assert 'axle friction is' in verdict.reason
    assert gate.rejections == {'beyond_friction': 1}


def test_commands_that_cannot_be_read_count_too(gate):
    assert gate.reject('steer is missing') == (False, 'steer is missing')
    gate.reject('names are wrong')
    check(gate, Fxf=math.nan)
    assert gate.rejections == {'unreadable': 2, 'not_finite': 1}
    assert gate.rejected == 3
    assert gate.last_reason == 'a value is not finite'


def test_a_refused_command_does_not_become_the_last_good_one(gate):
    refused = GOOD._replace(delta=0.26)
    assert not gate.check(refused, GOOD.stamp_ns, TICK_NS).accepted
    # 0.26 rad is near to itself and far from the 0.1 rad that still stands
    again = refused._replace(delta=0.255)
    assert not gate.check(again, GOOD.stamp_ns, TICK_NS).accepted
    assert gate.check(GOOD._replace(delta=0.2), GOOD.stamp_ns, TICK_NS).accepted
    assert gate.check(again, GOOD.stamp_ns, TICK_NS).accepted


def test_last_good_command_stands_after_a_refusal(params, car):
    other = Simulator(params, 1.0, Start(0.0, 0.0, 0.0, 20.0))
    for simulator in (car, other):
        simulator.advance(good(), TICK_STEPS)
    broken = car.advance(good(car.stamp_ns)._replace(Fxr=math.nan), TICK_STEPS)
    held = other.advance(None, TICK_STEPS)
    assert broken.rows.tobytes() == held.rows.tobytes()


def test_jump_is_allowed_in_the_time_it_needs(car):
    car.advance(good(), TICK_STEPS)
    far = Command(car.stamp_ns, 0.4, 0.0, 0.0, 0.0)
    assert not car.command(far).accepted
    car.advance(None, 4 * TICK_STEPS)
    assert car.command(far._replace(stamp_ns=car.stamp_ns)).accepted
