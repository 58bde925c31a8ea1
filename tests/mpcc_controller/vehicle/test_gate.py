"""The last check: what is turned back, and what leaves in its place."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller import stages
from mpcc_controller.gate import Gate
from msgs_yaml.types import Command

quick = settings(deadline=None, derandomize=True, max_examples=100)
LAST = Command(0, 0.1, 0.0, -3000.0, -2000.0)
GOOD = Command(50_000_000, 0.11, 0.2, -3300.0, -2200.0)


@pytest.fixture
def gate(params, vehicle):
    return Gate(params.limits, stages.car(params, vehicle), 0.05, 0.2)


def test_a_good_command_passes_unchanged(gate):
    assert gate.check(GOOD, LAST, 0.0) == (GOOD, '')
    assert not gate.rejections


@pytest.mark.parametrize(
    ('fault', 'last', 'age', 'reason'),
    [
        ({'delta': math.nan}, {}, 0.0, 'not_finite'),
        ({'d_delta': math.nan}, {}, 0.0, 'not_finite'),
        ({'Fxr': -math.inf}, {}, 0.0, 'not_finite'),
        ({}, {}, 0.3, 'too_old'),
        ({}, {}, math.nan, 'too_old'),
        ({'stamp_ns': 0}, {}, 0.0, 'not_newer'),
        ({'delta': 0.48}, {'delta': 0.47}, 0.0, 'out_of_range'),
        ({'Fxf': -10000.0, 'Fxr': -8000.0}, {'Fxf': -9500, 'Fxr': -7500}, 0.0, 'out_of_range'),
        ({'Fxf': 0.0, 'Fxr': 6500.0}, {'Fxf': 0.0, 'Fxr': 5900}, 0.0, 'out_of_range'),
        ({'Fxf': -2800.0, 'Fxr': 100.0}, {}, 0.0, 'out_of_range'),
        ({'delta': 0.14}, {}, 0.0, 'too_fast'),
        ({'d_delta': 0.6}, {}, 0.0, 'too_fast'),
        ({'Fxf': -5000.0, 'Fxr': -3000.0}, {}, 0.0, 'too_fast'),
        (
            {'Fxf': -500.0, 'Fxr': -10000.0},
            {'Fxr': -9000.0, 'Fxf': -1000.0},
            0.0,
            'beyond_friction',
        ),
        ({'Fxf': -12900.0, 'Fxr': 0.0}, {'Fxf': -12000.0, 'Fxr': 0.0}, 0.0, 'beyond_friction'),
    ],
)
def test_a_bad_command_is_turned_back_for_its_reason(gate, fault, last, age, reason):
    last = LAST._replace(**last)
    leaves, told = gate.check(GOOD._replace(**fault), last, age)
    assert told == reason
    assert gate.rejections == {reason: 1}
    assert leaves.delta == last.delta
    assert leaves.d_delta == 0


@quick
@given(
    st.builds(
        Command,
        st.just(50_000_000),
        *[st.floats(allow_nan=True, allow_infinity=True)] * 4,
    )
)
def test_whatever_comes_what_leaves_is_finite_and_within_the_rates(params, vehicle, command):
    gate = Gate(params.limits, stages.car(params, vehicle), 0.05, 0.2)
    leaves, _ = gate.check(command, LAST, 0.0)
    limits = params.limits
    assert all(math.isfinite(value) for value in leaves)
    assert abs(leaves.delta - LAST.delta) <= limits.steer_rate_radps * 0.05 * 1.001
    change = leaves.Fxf + leaves.Fxr - LAST.Fxf - LAST.Fxr
    assert abs(change) <= limits.force_rate_nps * 0.05 * 1.001


def test_held_commands_let_the_force_go(gate):
    held = LAST
    for _ in range(4):
        held, reason = gate.check(GOOD._replace(Fxf=math.nan), held, 0.0)
        assert reason == 'not_finite'
        held = held._replace(stamp_ns=0)
    assert (held.Fxf, held.Fxr) == (0, 0)
    assert gate.rejections['not_finite'] == 4
