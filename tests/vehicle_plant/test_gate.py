"""Commands that cannot be meant do not reach the servos."""

import math

import pytest

from msgs_yaml.types import Command
from vehicle_plant.simulator import START_NS, TICK_NS, TICK_STEPS, Simulator, Start


@pytest.fixture
def car(params):
    return Simulator(params, 1.0, Start(0.0, 0.0, 0.0, 20.0))


def good(stamp_ns=START_NS):
    return Command(stamp_ns, 0.01, 0.2, -500.0, -300.0)


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        ({'delta': math.nan}, 'not finite'),
        ({'Fxf': -math.inf}, 'not finite'),
        ({'delta': 0.6}, 'steer is'),
        ({'Fxf': 3000.0}, 'front_axle is'),
        ({'Fxr': -40e3}, 'rear_axle is'),
        ({'delta': 0.3}, 'steer step'),
        ({'stamp_ns': START_NS + TICK_NS}, 'future'),
        ({'stamp_ns': START_NS - TICK_NS}, 'older'),
    ],
)
def test_refuses_what_cannot_be_meant(car, change, reason):
    verdict = car.command(good()._replace(**change))
    assert not verdict.accepted
    assert reason in verdict.reason
    assert car.gate.rejected == 1
    assert car.gate.last_reason == verdict.reason


def test_last_good_command_stands_after_a_refusal(params, car):
    other = Simulator(params, 1.0, Start(0.0, 0.0, 0.0, 20.0))
    for one in (car, other):
        one.advance(good(), TICK_STEPS)
    broken = car.advance(good(car.stamp_ns)._replace(Fxr=math.nan), TICK_STEPS)
    held = other.advance(None, TICK_STEPS)
    assert broken.rows.tobytes() == held.rows.tobytes()


def test_accepts_what_a_controller_asks_for_at_its_limits(params, car):
    delta, Fxf, Fxr = 0.0, 0.0, 0.0
    for _ in range(40):
        delta = min(delta + 0.026, params.car.steering.limit_rad)
        Fxf, Fxr = max(Fxf - 8000, -16e3), max(Fxr - 8000, -12e3)
        car.advance(Command(car.stamp_ns, delta, 0.5, Fxf, Fxr), TICK_STEPS)
    assert car.gate.rejected == 0


def test_jump_is_allowed_in_the_time_it_needs(car):
    car.advance(good(), TICK_STEPS)
    far = Command(car.stamp_ns, 0.4, 0.0, 0.0, 0.0)
    assert not car.command(far).accepted
    car.advance(None, 4 * TICK_STEPS)
    assert car.command(far._replace(stamp_ns=car.stamp_ns)).accepted
