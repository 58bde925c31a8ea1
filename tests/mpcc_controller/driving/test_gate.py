"""The last check of a command: what is rejected, and what is sent instead."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.driving.gate import UNTIMELY, Gate
from msgs_yaml.types import Command

STEP, MAX_AGE = 0.05, 0.2
MU_FRONT, MU_REAR = 0.95, 0.97
# of mpcc.yaml
STEER, DRIVE, TURN_RATE = 0.471, 6000.0, 0.524
TURN, PUSH = TURN_RATE * STEP, 40000.0 * STEP
WEIGHT, FRONT, REAR, WHEELBASE, HEIGHT = 18148.5, 1.43, 1.46, 2.89, 0.54
LAST = Command(0, 0.1, 0.0, -3000.0, -2000.0)
GOOD = Command(50_000_000, 0.11, 0.2, -3300.0, -2200.0)


@pytest.fixture(scope='module')
def car(car):
    return car._replace(mu_f=MU_FRONT, mu_r=MU_REAR)


@pytest.fixture(scope='module')
def gate(car, params):
    return Gate(params.limits, car, STEP, MAX_AGE)


def change(last=(), **fields):
    """Return the good command and the last one, with other fields."""
    return GOOD._replace(**fields), LAST._replace(**dict(last))


def constant(front, rear):
    """Return a command of the same forces as the last one."""
    return change({'Fxf': front, 'Fxr': rear}, Fxf=front, Fxr=rear)


def axle_limit(mu, load, sign, height=HEIGHT):
    """Return the braking force that one axle alone holds: F = mu (load +- height F / wheelbase)."""
    return mu * WEIGHT * load / (WHEELBASE - sign * mu * height)


# commands on a limit, and `s` times beyond it
LIMITS = {
    'steer to the left': (lambda s: change({'delta': 0.46}, delta=STEER * s), 'out_of_range'),
    'steer to the right': (lambda s: change({'delta': -0.46}, delta=-STEER * s), 'out_of_range'),
    'brakes': (
        lambda s: change({'Fxf': -11e3, 'Fxr': -5.5e3}, Fxf=-11600.0 * s, Fxr=-5400.0 * s),
        'out_of_range',
    ),
    'drive': (
        lambda s: change({'Fxf': 0.0, 'Fxr': 5900.0}, Fxf=0.0, Fxr=DRIVE * s),
        'out_of_range',
    ),
    'turn to the left': (lambda s: change(delta=0.1 + TURN * s), 'too_fast'),
    'turn to the right': (lambda s: change(delta=0.1 - TURN * s), 'too_fast'),
    'rate to the left': (lambda s: change(d_delta=TURN_RATE * s), 'too_fast'),
    'rate to the right': (lambda s: change(d_delta=-TURN_RATE * s), 'too_fast'),
    'more braking': (lambda s: change(Fxf=-4500.0, Fxr=-500.0 - PUSH * s), 'too_fast'),
    'less braking': (lambda s: change(Fxf=-2500.0, Fxr=-2500.0 + PUSH * s), 'too_fast'),
    'the sum of both axles': (lambda s: change(Fxf=0.0, Fxr=-5000.0 - PUSH * s), 'too_fast'),
    'front friction': (
        lambda s: constant(-s * axle_limit(MU_FRONT, REAR, 1), 0.0),
        'beyond_friction',
    ),
    'rear friction': (
        lambda s: constant(0.0, -s * axle_limit(MU_REAR, FRONT, -1)),
        'beyond_friction',
    ),
}


@pytest.mark.parametrize('name', LIMITS)
def test_a_command_on_its_limit_passes_with_a_rounding_error_and_not_beyond(gate, name):
    command_at, reason = LIMITS[name]
    for beyond, expected in ((0.0, ''), (5e-7, ''), (2e-6, reason)):
        command, last = command_at(1 + beyond)
        sent, rejection = gate.check(command, last, 0.0, gate.car)
        assert rejection == expected
        held = last._replace(stamp_ns=command.stamp_ns, d_delta=0.0)
        assert sent[:3] == (held if expected else command)[:3]


@pytest.mark.parametrize(
    ('pair', 'age', 'reason'),
    [
        (change(), 0.0, ''),
        (change(stamp_ns=1), MAX_AGE, ''),
        (change(), -STEP * (1 - 1e-5), ''),
        (change({'Fxf': 900.0, 'Fxr': 900.0}, Fxf=1000.0, Fxr=1000.0), 0.0, ''),
        (change(Fxf=0.0, Fxr=-5000.0), 0.0, ''),
        (change(Fxf=-5000.0, Fxr=0.0), 0.0, ''),
        *((change(**{name: value}), 0.0, 'not_finite')
          for name in ('delta', 'd_delta', 'Fxf', 'Fxr') for value in (math.nan, -math.inf)),
        *((change(), age, 'too_old') for age in (MAX_AGE * (1 + 1e-5), math.nan, math.inf)),
        *((change(), age, 'from_future') for age in (-STEP, -1.0)),
        *((change(stamp_ns=stamp_ns), 0.0, 'not_newer') for stamp_ns in (0, -1)),
        # no axle drives while the other brakes
        (change(Fxf=-4800.0, Fxr=1.0), 0.0, 'out_of_range'),
        (change(Fxf=1.0, Fxr=-4800.0), 0.0, 'out_of_range'),
        (change({'Fxf': 0.0, 'Fxr': 0.0}, Fxf=-0.5, Fxr=0.5), 0.0, 'out_of_range'),
        # the first of several faults is the reason
        (change(delta=math.nan, Fxf=-1e6), 9.0, 'not_finite'),
        (change(delta=3.0), 9.0, 'too_old'),
        (change(delta=3.0), 0.0, 'out_of_range'),
    ],
)  # fmt: skip
def test_the_first_fault_of_a_command_is_the_reason_to_hold_the_last_one(gate, pair, age, reason):
    command, last = pair
    sent, rejection = gate.check(command, last, age, gate.car)
    assert rejection == reason
    held = (command.stamp_ns, last.delta, 0.0)
    assert sent[:3] == (held if reason else command[:3])
    untimely = reason in ('too_old', 'from_future', 'not_newer')
    assert (reason in UNTIMELY) == untimely


@pytest.mark.parametrize('axle', ['front', 'rear'])
def test_driving_unloads_the_front_axle_and_loads_the_rear(car, params, axle):
    slippery = Gate(params.limits, car._replace(mu_f=0.3, mu_r=0.3), STEP, MAX_AGE)
    limit = axle_limit(0.3, REAR, -1) if axle == 'front' else axle_limit(0.3, FRONT, 1)
    for share, reason in ((1 - 1e-5, ''), (1 + 1e-5, 'beyond_friction')):
        forces = (share * limit, 0.0) if axle == 'front' else (0.0, share * limit)
        assert slippery.check(*constant(*forces), 0.0, slippery.car).reason == reason


@pytest.mark.parametrize(
    ('last', 'forces', 'reason'),
    [
        ((-4000.0, -2000.0), (-4000.0, -2000.0), ''),
        ((-4000.0, -2000.0), (-3500.0, -1800.0), ''),
        ((-4000.0, -2000.0), (-4100.0, -2000.0), 'beyond_friction'),
        ((-4000.0, -2000.0), (-2500.0, -3500.0), 'beyond_friction'),
        ((-2500.0, -2000.0), (-3000.0, -2000.0), ''),
        ((-2500.0, -2000.0), (-3200.0, -2000.0), 'beyond_friction'),
    ],
)
def test_where_less_friction_is_believed_forces_may_fall_but_not_grow(
    gate, car, last, forces, reason
):
    """Under 6,000 N of braking the front axle holds 3,087 N, the rear axle 2,357 N."""
    believed = car._replace(mu_f=0.3, mu_r=0.3)
    command, before = change(zip(('Fxf', 'Fxr'), last), Fxf=forces[0], Fxr=forces[1])
    assert gate.check(command, before, 0.0, believed).reason == reason


def test_each_axle_has_the_rate_of_its_actuators(params, car):
    slow = Gate(params.limits, car, STEP, MAX_AGE, axle_rate_nps=10000.0)
    for share, reason in ((1 - 1e-5, ''), (1 + 1e-5, 'too_fast')):
        command, last = change(Fxf=LAST.Fxf - 500.0 * share, Fxr=LAST.Fxr + 500.0 * share)
        assert slow.check(command, last, 0.0, car).reason == reason


@settings(max_examples=100)
@given(st.builds(Command, st.just(50_000_000), *[st.floats()] * 4))
def test_every_command_that_is_sent_is_finite_and_within_the_rate_limits(gate, command):
    sent, _ = gate.check(command, LAST, 0.0, gate.car)
    assert all(math.isfinite(value) for value in sent)
    assert abs(sent.delta - LAST.delta) <= TURN * (1 + 1e-5)
    assert abs(sent.Fxf + sent.Fxr - LAST.Fxf - LAST.Fxr) <= PUSH * (1 + 1e-5)


@pytest.mark.parametrize(
    ('last', 'held'),
    [
        ((-3000.0, -2000.0), (-3000.0, -2000.0)),
        ((-0.6, -0.4), (-0.6, -0.4)),
        ((0.0, 0.0), (0.0, 0.0)),
        ((0.0, 5000.0), (0.0, 3000.0)),
        ((2000.0, 3000.0), (1200.0, 1800.0)),
        ((0.0, 1000.0), (0.0, 0.0)),
    ],
)
def test_a_held_command_keeps_braking_and_stops_driving_at_the_rate_limit(gate, last, held):
    command, before = change(zip(('Fxf', 'Fxr'), last), delta=math.nan)
    sent, _ = gate.check(command, before, 0.0, gate.car)
    assert (sent.Fxf, sent.Fxr) == pytest.approx(held)


def test_what_is_asked_of_lost_brakes_does_not_count(gate, car):
    # the load that the rear axle has when it brakes alone, while the front is still asked
    alone = axle_limit(MU_REAR, FRONT, -1)
    for share, reason in ((0.999, ''), (1.001, 'beyond_friction')):
        command, last = constant(-8000.0, -share * alone)
        lost = gate._replace(lost='Fxf')
        last = last._replace(Fxr=-0.9 * alone)
        assert lost.check(command, last, 0.0, car).reason == reason
        assert gate.check(command, last, 0.0, car).reason == 'beyond_friction'
