"""Commands that cannot be meant do not reach the servos; what the controller may ask for does."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from drives import OPEN_GATE, ahead, altered

from mpcc_controller import car_file
from mpcc_controller.driving import gate as controller_gate
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.problem import stage_parameters
from msgs_yaml import share
from msgs_yaml.types import Command
from node_runtime import parameters
from vehicle_plant import stepping
from vehicle_plant.gate import OLDEST_TICKS, Gate, axle_friction
from vehicle_plant.simulator import START_NS, TICK_NS, TICK_STEPS, Simulator
from vehicle_plant.state import SetPoints

HELD = SetPoints(0.1, -4000.0, -3000.0)
GOOD = Command(START_NS + TICK_NS, 0.11, 0.2, -4500.0, -3300.0)
STILL = {'Fxf': 0.0, 'Fxr': 0.0}


@pytest.fixture
def gate(params):
    return Gate(params, 1.0, HELD, START_NS)


def check(gate, now_ns=START_NS + TICK_NS, **change):
    return gate.check(GOOD._replace(**change), now_ns, TICK_NS)


def test_a_command_that_can_be_meant_passes_and_may_come_again(gate):
    assert check(gate) == check(gate) == (True, '')
    assert (gate.rejected, gate.last_reason, dict(gate.rejections)) == (0, '', {})
    assert not check(gate, stamp_ns=START_NS + TICK_NS - 1).accepted


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
        ({'delta': 0.3}, 'too_fast', 'steer step is 0.2 rad, allowed -0.15 to 0.15'),
        ({'delta': -0.1}, 'too_fast', 'steer step is -0.2 rad, allowed -0.15 to 0.15'),
        ({'Fxf': 3000.0}, 'out_of_range', 'front_axle is 3000 N, allowed -16500 to 500'),
        ({'Fxf': -17e3}, 'out_of_range', 'front_axle is -17000 N, allowed -16500 to 500'),
        ({'Fxr': -40e3}, 'out_of_range', 'rear_axle is -40000 N, allowed -12500 to 7500'),
        ({'Fxr': 8e3}, 'out_of_range', 'rear_axle is 8000 N, allowed -12500 to 7500'),
    ],
)
def test_a_command_that_cannot_be_meant_is_refused_for_its_reason(gate, change, code, reason):
    assert check(gate, **change) == (False, reason)
    assert gate.rejections == {code: 1}
    assert (gate.rejected, gate.last_code, gate.last_reason) == (1, code, reason)


def test_the_limits_of_range_themselves_pass(params):
    car = params.car
    front, rear, steer = car.force.front, car.force.rear, car.steering.limit_rad + 0.01
    for change in (
        {'delta': steer},
        {'delta': -steer},
        {'Fxf': -front.brake_n - 500},
        {'Fxf': front.drive_n + 500},
        {'Fxr': -rear.brake_n - 500},
        {'Fxr': rear.drive_n + 500},
    ):
        wide = altered(params, car__gate=replace(car.gate, **OPEN_GATE))
        assert check(Gate(wide, 1.0, HELD, START_NS), **change).accepted


@pytest.mark.parametrize('sign', [1, -1])
@pytest.mark.parametrize(('name', 'rate'), [('delta', 3.0), ('Fxf', 4e4), ('Fxr', 4e4)])
@pytest.mark.parametrize(('ticks', 'counted'), [(0, 1), (1, 1), (2, 2)])
@pytest.mark.parametrize('begin_ns', [0, TICK_NS, START_NS])
def test_rates_count_over_the_time_since_the_last_command_at_least_a_tick(
    params, begin_ns, ticks, counted, name, rate, sign
):
    """As differences, whatever the stamps: also right after time began."""
    plant = altered(params, car__gate__force_rate_nps=4e4, car__gate__friction_use=10.0)
    held = SetPoints(0.0, -6000.0, -6000.0)
    resting = Command(begin_ns + ticks * TICK_NS, held.delta, 0.0, held.Fxf, held.Fxr)
    step = sign * rate * counted * TICK_NS / 1e9
    for part, passes in ((1 - 1e-9, True), (1 + 1e-6, False)):
        command = resting._replace(**{name: getattr(held, name) + part * step})
        gate = Gate(plant, 1.0, held, begin_ns)
        assert gate.check(command, begin_ns + 2 * TICK_NS, TICK_NS).accepted == passes


def test_a_command_is_too_old_when_it_is_held_no_longer(gate):
    assert OLDEST_TICKS == 1 + stepping.HELD_TICKS
    oldest = GOOD.stamp_ns + OLDEST_TICKS * TICK_NS
    assert check(gate, oldest + 1) == (False, 'the command is 0.15 s old')
    assert gate.rejections == {'too_old': 1}
    assert check(gate, oldest).accepted


@pytest.mark.parametrize(
    ('axle', 'sign'), [('Fxf', -1), ('Fxr', -1), ('Fxr', 1)], ids=['front', 'rear', 'drive']
)
@pytest.mark.parametrize('friction', [0.3, 1.0, 1.2])
def test_more_than_the_share_that_the_tyres_hold_is_refused(params, axle, sign, friction):
    """On a slippery road, too, an axle may be asked for what locks it on a good one."""
    use = 0.5
    plant = altered(params, car__gate=replace(params.car.gate, **OPEN_GATE | {'friction_use': use}))
    gate = Gate(plant, friction, SetPoints(0.1, 0.0, 0.0), START_NS)
    force = 4000.0  # by fixed-point iteration: the limit depends on the force itself
    for _ in range(60):
        front, rear = axle_friction(sign * force, plant, max(friction, 1.0))
        force = use * (front if axle == 'Fxf' else rear)
    assert check(gate, **STILL | {axle: sign * force * (1 - 1e-6)}).accepted
    verdict = check(gate, **STILL | {axle: sign * force * (1 + 1e-6)})
    assert not verdict.accepted
    assert 'axle friction is' in verdict.reason
    assert gate.rejections == {'beyond_friction': 1}


def test_a_refused_command_does_not_become_the_last_good_one(gate):
    """0.26 rad is near to itself and far from the 0.1 rad that still stands."""
    for delta, passes in ((0.26, False), (0.255, False), (0.2, True), (0.255, True)):
        assert check(gate, delta=delta).accepted == passes


def test_the_last_good_command_stands_after_a_refusal_and_a_jump_passes_in_its_time(params):
    good = Command(START_NS, 0.01, 0.2, -500.0, -300.0)
    refused, held = (Simulator(params, 1.0, ahead(20.0)) for _ in range(2))
    for car in (refused, held):
        car.advance(good, TICK_STEPS)
    jump = Command(held.stamp_ns, 0.4, 0.0, 0.0, 0.0)
    rows = refused.advance(jump, TICK_STEPS).rows
    assert rows.tobytes() == held.advance(None, TICK_STEPS).rows.tobytes()
    held.advance(None, 3 * TICK_STEPS)
    assert held.command(jump._replace(stamp_ns=held.stamp_ns)).accepted


def friction_of_load(load, LMUX=0.85, nominal=4000):
    return LMUX * (1.21 - 0.037 * (load / 2 - nominal) / nominal) * load


WEIGHT_N, WHEELBASE_M = 18148.5, 2.89
LOADS = WEIGHT_N * 1.46 / WHEELBASE_M, WEIGHT_N * 1.43 / WHEELBASE_M


@pytest.mark.parametrize('friction', [1.0, 2.0])
@pytest.mark.parametrize('Fx', [0.0, -10000.0, 10000.0])
def test_the_friction_of_the_axles_is_that_of_the_tyre_under_their_load(params, Fx, friction):
    """By hand: 18148.5 N on 1.43 m and 1.46 m, CoG at 0.54 m; mu = 0.85 (1.21 - 0.037 dfz)."""
    moved = 0.54 * Fx / WHEELBASE_M
    front, rear = (friction_of_load(load) for load in (LOADS[0] - moved, LOADS[1] + moved))
    expected = friction * front, friction * rear
    assert axle_friction(Fx, params, friction) == pytest.approx(expected, rel=1e-12)


def test_no_more_load_moves_than_the_friction_of_the_whole_car_can_move(params):
    most = 1.21 * WEIGHT_N
    assert axle_friction(-9e9, params, 1.0) == axle_friction(-most, params, 1.0)
    assert axle_friction(9e9, params, 1.0) == axle_friction(most, params, 1.0)
    assert axle_friction(-1.1 * most, params, 1.2) != axle_friction(-most, params, 1.2)
    assert axle_friction(-0.9 * most, params, 1.0) != axle_friction(-most, params, 1.0)


@pytest.mark.parametrize(('name', 'which'), [('front', 0), ('rear', 1)])
def test_each_axle_has_the_tyre_of_its_own_scaling(params, name, which):
    factors = {f'car__scaling__{name}__{k}': v for k, v in (('LMUX', 1.7), ('LFZO', 2.0))}
    changed = axle_friction(0.0, altered(params, **factors), 1.0)
    expected = [friction_of_load(load) for load in LOADS]
    expected[which] = friction_of_load(LOADS[which], 1.7, 8000)
    assert changed == pytest.approx(expected, rel=1e-12)


BRAKES, DRIVES = -1, 1
# where both axles are at their limit lies between shares of 0.4 and 0.9 at the front
ASKED = [*((BRAKES, share) for share in (0.0, 0.4, 0.6, 0.7, 0.9, 1.0)), (DRIVES, 0.0)]


class Controller:
    """The default controller's gate on a road of this friction."""

    def __init__(self, friction):
        path = share.path('mpcc_controller', 'config', 'mpcc.yaml')
        params = altered(parameters.load(ControllerParams, path), model__friction=friction)
        self.car = stage_parameters.car(params, car_file.load(params))
        self.limits, self.step_s = params.limits, params.model.step_s
        age_s = params.fallback.max_state_age_s
        self.gate = controller_gate.Gate(params.limits, self.car, self.step_s, age_s)

    def command(self, tick, force, front):
        """Return a command that steers as fast as it may up to the limit."""
        limits = self.limits
        delta = min(tick * limits.steer_rate_radps * self.step_s, limits.steer_rad)
        forces = front * force, (1 - front) * force
        return Command(START_NS + tick * TICK_NS, delta, limits.steer_rate_radps, *forces)

    def accepts(self, new, old):
        return not self.gate.check(new, old, 0.0, self.car).reason

    def most(self, sign, front):
        """Return the greatest force [N] of both axles, of this share at the front, that passes."""
        low, high = 0.0, 1e5
        for _ in range(60):
            middle = (low + high) / 2
            held, again = (self.command(tick, sign * middle, front) for tick in (0, 1))
            low, high = (middle, high) if self.accepts(again, held) else (low, middle)
        return sign * low

    def pushed(self, most, front):
        """Return commands from rest to this force, as fast as it may grow."""
        push = self.limits.force_rate_nps * self.step_s
        forces = np.copysign(np.minimum(np.arange(40) * push, abs(most)), most).tolist()
        return [self.command(tick, force, front) for tick, force in enumerate(forces)]


def assert_both_accept(params, friction, controller, commands):
    assert all(controller.accepts(new, old) for old, new in pairwise(commands))
    car = Simulator(params, friction, ahead(20.0))
    for command in commands:
        car.advance(command, TICK_STEPS)
    assert not car.gate.rejections


@pytest.mark.parametrize('friction', [0.3, 1.0, 1.2])
@pytest.mark.parametrize(('sign', 'front'), ASKED)
def test_the_plant_accepts_what_the_controller_may_ask_for(params, sign, front, friction):
    controller = Controller(friction)
    most = controller.most(sign, front)
    commands = controller.pushed(most, front)
    beyond = controller.command(len(commands), 1.001 * most, front)
    assert not controller.accepts(beyond, commands[-1])
    assert_both_accept(params, friction, controller, commands)


def test_the_split_of_full_brakes_may_change_at_once(params):
    """The controller's gate has no limit for that."""
    controller = Controller(1.0)
    force = max(controller.most(BRAKES, front) for front in (0.0, 1.0))
    commands = controller.pushed(force, 0.0)
    commands += [controller.command(40 + i, force, front) for i, front in enumerate((1.0, 0.0))]
    assert_both_accept(params, 1.0, controller, commands)
