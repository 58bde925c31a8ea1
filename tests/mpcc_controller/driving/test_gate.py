"""The last check of a command: what is rejected, and what is sent instead."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.driving.gate import UNTIMELY, Gate
from msgs_yaml.types import Command

quick = settings(max_examples=100)
STEP, MAX_AGE = 0.05, 0.2
MU_FRONT, MU_REAR = 0.95, 0.97
# the friction of the front axle by hand: weight 18148.5 N, 2.89 m, 0.54 m up
FRONT_AT_12_KN = MU_FRONT * (18148.5 * 1.46 + 0.54 * 12000) / 2.89
LAST = Command(0, 0.1, 0.0, -3000.0, -2000.0)
GOOD = Command(50_000_000, 0.11, 0.2, -3300.0, -2200.0)
OVER, UNDER = 1 + 1e-5, 1 - 1e-5


@pytest.fixture(scope='module')
def car(car):
    return car._replace(mu_f=MU_FRONT, mu_r=MU_REAR)


@pytest.fixture
def gate(car, params):
    return Gate(params.limits, car, STEP, MAX_AGE)


def change(**fields):
    return GOOD._replace(**fields), LAST


def step(last, **fields):
    """Return a command and the previous command, which differs from LAST."""
    return GOOD._replace(**fields), LAST._replace(**last)


def test_a_good_command_passes_unchanged(gate):
    assert gate.check(GOOD, LAST, 0.0, gate.car) == (GOOD, '')


TURN, PUSH = 0.524 * STEP, 40000.0 * STEP


@pytest.mark.parametrize(
    ('pair', 'age', 'reason'),
    [
        (change(delta=math.nan), 0.0, 'not_finite'),
        (change(d_delta=math.nan), 0.0, 'not_finite'),
        (change(d_delta=-math.inf), 0.0, 'not_finite'),
        (change(Fxf=math.nan), 0.0, 'not_finite'),
        (change(Fxr=-math.inf), 0.0, 'not_finite'),
        (change(), MAX_AGE * OVER, 'too_old'),
        (change(), math.nan, 'too_old'),
        (change(), math.inf, 'too_old'),
        (change(), -STEP, 'from_future'),
        (change(), -1.0, 'from_future'),
        (change(stamp_ns=0), 0.0, 'not_newer'),
        (change(stamp_ns=-1), 0.0, 'not_newer'),
        (step({'delta': 0.47}, delta=0.471 * OVER), 0.0, 'out_of_range'),
        (step({'delta': -0.47}, delta=-0.471 * OVER), 0.0, 'out_of_range'),
        (
            step({'Fxf': -9900.0, 'Fxr': -6600.0}, Fxf=-10200 * OVER, Fxr=-6800.0 * OVER),
            0.0,
            'out_of_range',
        ),
        (step({'Fxf': 0.0, 'Fxr': 5900.0}, Fxf=0.0, Fxr=6000 * OVER), 0.0, 'out_of_range'),
        (change(Fxf=-4800.0, Fxr=1.0), 0.0, 'out_of_range'),
        (change(Fxf=1.0, Fxr=-4800.0), 0.0, 'out_of_range'),
        (step({'Fxf': 0.0, 'Fxr': 0.0}, Fxf=-0.5, Fxr=0.5), 0.0, 'out_of_range'),
        (change(delta=0.1 + TURN * OVER), 0.0, 'too_fast'),
        (change(delta=0.1 - TURN * OVER), 0.0, 'too_fast'),
        (change(d_delta=0.524 * OVER), 0.0, 'too_fast'),
        (change(d_delta=-0.524 * OVER), 0.0, 'too_fast'),
        (change(Fxf=-4500.0, Fxr=-500.0 - PUSH * OVER), 0.0, 'too_fast'),
        (change(Fxf=-2500.0, Fxr=-2500.0 + PUSH * OVER), 0.0, 'too_fast'),
        # the rate limit applies to the sum of both axles
        (change(Fxf=0.0, Fxr=-5000.0 - PUSH * OVER), 0.0, 'too_fast'),
        (
            step({'Fxf': -12000.0, 'Fxr': 0.0}, Fxf=-FRONT_AT_12_KN * 1.05, Fxr=0.0),
            0.0,
            'beyond_friction',
        ),
        (step({'Fxf': -3000.0, 'Fxr': -7500.0}, Fxf=-4000, Fxr=-7000.0), 0.0, 'beyond_friction'),
    ],
)
def test_a_bad_command_is_rejected_with_its_reason(gate, pair, age, reason):
    command, last = pair
    sent, rejection = gate.check(command, last, age, gate.car)
    assert rejection == reason
    assert (sent.stamp_ns, sent.delta, sent.d_delta) == (command.stamp_ns, last.delta, 0.0)


@pytest.mark.parametrize(
    ('pair', 'age'),
    [
        (change(), MAX_AGE),
        (change(), -STEP * UNDER),
        (change(stamp_ns=1), 0.0),
        (step({'delta': 0.46}, delta=0.471), 0.0),
        (step({'delta': -0.46}, delta=-0.471), 0.0),
        (step({'Fxf': -11000.0, 'Fxr': -5500.0}, Fxf=-11600.0, Fxr=-5400.0), 0.0),
        (step({'Fxf': 0.0, 'Fxr': 5900.0}, Fxf=0.0, Fxr=6000.0), 0.0),
        (step({'Fxf': 900.0, 'Fxr': 900.0}, Fxf=1000.0, Fxr=1000.0), 0.0),
        (change(Fxf=0.0, Fxr=-5000.0), 0.0),
        (change(Fxf=-5000.0, Fxr=0.0), 0.0),
        (change(delta=0.1 + TURN), 0.0),
        (change(delta=0.1 - TURN), 0.0),
        (change(d_delta=0.524), 0.0),
        (change(d_delta=-0.524), 0.0),
        (change(Fxf=-4500.0, Fxr=-500.0 - PUSH), 0.0),
        (change(Fxf=-2500.0, Fxr=-2500.0 + PUSH), 0.0),
    ],
)
def test_a_command_on_its_limit_passes(gate, pair, age):
    command, last = pair
    assert gate.check(command, last, age, gate.car) == (command, '')


@pytest.mark.parametrize('name', ['delta', 'd_delta'])
def test_a_rounding_error_beyond_a_limit_passes_and_twice_the_allowance_does_not(
    gate, params, name
):
    limit = {'delta': params.limits.steer_rad, 'd_delta': params.limits.steer_rate_radps}[name]
    last = LAST._replace(delta=0.47)
    for beyond, passes in ((5e-7, True), (2e-6, False)):
        command = GOOD._replace(delta=0.47)._replace(**{name: limit * (1 + beyond)})
        assert (gate.check(command, last, 0.0, gate.car).reason == '') == passes


@pytest.mark.parametrize(('share', 'reason'), [(UNDER, ''), (OVER, 'beyond_friction')])
def test_the_friction_of_an_axle_is_that_of_its_load_under_the_braking(gate, share, reason):
    def check_constant(front, rear):
        """Return the reason for which the gate rejects constant forces, or ''."""
        command = GOOD._replace(Fxf=front, Fxr=rear)
        return gate.check(command, command._replace(stamp_ns=0), 0.0, gate.car).reason

    # front: F = 0.95 (18148.5 * 1.46 + 0.54 F) / 2.89, all on one axle
    front = 0.95 * 18148.5 * 1.46 / (2.89 - 0.95 * 0.54)
    rear = 0.97 * 18148.5 * 1.43 / (2.89 + 0.97 * 0.54)
    assert check_constant(-front * share, 0.0) == reason
    assert check_constant(0.0, -rear * share) == reason


def test_driving_unloads_the_front_axle_and_loads_the_rear(car, params):
    # a front-driven car of little grip: F = mu (18148.5 * 1.46 - 0.54 F) / 2.89
    slippery = Gate(params.limits, car._replace(mu_f=0.3, mu_r=0.3), STEP, MAX_AGE)
    front = 0.3 * 18148.5 * 1.46 / (2.89 + 0.3 * 0.54)
    rear = 0.3 * 18148.5 * 1.43 / (2.89 - 0.3 * 0.54)
    for share, reason in ((UNDER, ''), (OVER, 'beyond_friction')):
        for Fxf, Fxr in ((front * share, 0.0), (0.0, rear * share)):
            command = GOOD._replace(Fxf=Fxf, Fxr=Fxr)
            rejection = slippery.check(
                command, command._replace(stamp_ns=0), 0.0, slippery.car
            ).reason
            assert rejection == reason


def test_where_less_friction_is_believed_forces_may_fall_but_not_grow(gate, car):
    believed = car._replace(mu_f=0.3, mu_r=0.3)
    # under 6,000 N of braking the front axle holds 3,087 N, the rear axle 2,357 N
    last = LAST._replace(Fxf=-4000.0, Fxr=-2000.0)
    for forces, reason in (
        ((-4000.0, -2000.0), ''),
        ((-3500.0, -1800.0), ''),
        ((-4100.0, -2000.0), 'beyond_friction'),
        ((-2500.0, -3500.0), 'beyond_friction'),
    ):
        command = GOOD._replace(Fxf=forces[0], Fxr=forces[1])
        assert gate.check(command, last, 0.0, believed).reason == reason, forces
    within = LAST._replace(Fxf=-2500.0, Fxr=-2000.0)
    for front, reason in ((-3000.0, ''), (-3200.0, 'beyond_friction')):
        command = within._replace(stamp_ns=1, Fxf=front)
        assert gate.check(command, within, 0.0, believed).reason == reason


def test_each_axle_has_the_rate_of_its_actuators(params, car):
    slow = Gate(params.limits, car, STEP, MAX_AGE, axle_rate_nps=10000.0)
    for shift, reason in ((500.0 * UNDER, ''), (500.0 * OVER, 'too_fast')):
        command = LAST._replace(stamp_ns=1, Fxf=LAST.Fxf - shift, Fxr=LAST.Fxr + shift)
        assert slow.check(command, LAST, 0.0, car).reason == reason


def test_the_first_fault_is_the_reason(gate):
    for command, age, reason in (
        (GOOD._replace(delta=math.nan, Fxf=-1e6), 9.0, 'not_finite'),
        (GOOD._replace(delta=3.0), 9.0, 'too_old'),
        (GOOD._replace(delta=3.0), 0.0, 'out_of_range'),
    ):
        assert gate.check(command, LAST, age, gate.car).reason == reason


@quick
@given(
    st.builds(
        Command,
        st.just(50_000_000),
        *[st.floats(allow_nan=True, allow_infinity=True)] * 4,
    )
)
def test_every_command_that_is_sent_is_finite_and_within_the_rate_limits(car, params, command):
    gate = Gate(params.limits, car, STEP, MAX_AGE)
    sent, _ = gate.check(command, LAST, 0.0, gate.car)
    assert all(math.isfinite(value) for value in sent)
    assert abs(sent.delta - LAST.delta) <= TURN * OVER
    assert abs(sent.Fxf + sent.Fxr - LAST.Fxf - LAST.Fxr) <= PUSH * OVER


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
    before = LAST._replace(Fxf=last[0], Fxr=last[1])
    sent, _ = gate.check(GOOD._replace(delta=math.nan), before, 0.0, gate.car)
    assert (sent.Fxf, sent.Fxr) == pytest.approx(held)


def test_no_command_passes_for_a_state_of_the_wrong_age_or_order(gate):
    assert UNTIMELY == ('too_old', 'from_future', 'not_newer')
    for age, last in ((MAX_AGE * 2, LAST), (-1.0, LAST), (0.0, GOOD)):
        assert gate.check(GOOD, last, age, gate.car).reason in UNTIMELY
