"""What passes the gate of the controller, up to its limits, passes that of the plant."""

import math
from dataclasses import replace
from itertools import pairwise

import pytest

from mpcc_controller import car_file
from mpcc_controller.driving.gate import Gate
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.problem import stage_parameters
from msgs_yaml import share
from msgs_yaml.types import Command
from node_runtime import parameters
from vehicle_plant.initial_state import Start
from vehicle_plant.simulator import START_NS, TICK_NS, TICK_STEPS, Simulator

FRESH_S = 0.0
MOST_N = 1e5  # no gate lets this pass
BRAKES, DRIVES = -1, 1
REAR, FRONT = 0.0, 1.0  # shares of the front axle
TICKS = 40  # enough to reach every limit from rest
# where both axles are at their limit lies between 0.4 and 0.9
ASKED = [*((BRAKES, share) for share in (REAR, 0.4, 0.6, 0.7, 0.9, FRONT)), (DRIVES, REAR)]


class Controller:
    """The default controller's gate on a road of this friction, and what it allows."""

    def __init__(self, friction):
        params = parameters.load(
            ControllerParams, share.path('mpcc_controller', 'config', 'mpcc.yaml')
        )
        params = replace(params, model=replace(params.model, friction=friction))
        car = self.car = stage_parameters.car(params, car_file.load(params))
        self.limits, self.step_s = params.limits, params.model.step_s
        self.gate = Gate(params.limits, car, self.step_s, params.fallback.max_state_age_s)

    def reason(self, command, last):
        """Return why a command does not pass, '' when it does."""
        return self.gate.check(command, last, FRESH_S, self.car).reason

    def most(self, sign, front):
        """Return the greatest force [N] of both axles, of this share at the front, that passes."""
        low, high = 0.0, MOST_N
        for _ in range(60):
            middle = (low + high) / 2
            held = command_for(START_NS, 0.0, 0.0, sign * middle, front)
            if self.reason(held._replace(stamp_ns=START_NS + TICK_NS), held):
                high = middle
            else:
                low = middle
        return sign * low


def command_for(stamp_ns, delta, d_delta, force, front):
    return Command(stamp_ns, delta, d_delta, front * force, (1 - front) * force)


def pushed(controller, most, front):
    """Return commands from rest to a force and to full steer, as fast as they may change."""
    limits = controller.limits
    turn, push = (
        limits.steer_rate_radps * controller.step_s,
        limits.force_rate_nps * controller.step_s,
    )
    return [
        command_for(
            START_NS + n * TICK_NS,
            min(n * turn, limits.steer_rad),
            limits.steer_rate_radps,
            math.copysign(min(n * push, abs(most)), most),
            front,
        )
        for n in range(TICKS)
    ]


def passes_both(params, friction, controller, commands):
    """Tell whether a sequence passes the controller's gate, then whether it passes the plant's."""
    refused = [controller.reason(new, old) for old, new in pairwise(commands)]
    car = Simulator(params, friction, Start(0.0, 0.0, 0.0, 20.0))
    for command in commands:
        car.advance(command, TICK_STEPS)
    return not any(refused), not car.gate.rejections


@pytest.mark.parametrize('friction', [0.3, 1.0, 1.2])
@pytest.mark.parametrize(('sign', 'front'), ASKED)
def test_the_plant_accepts_what_the_controller_may_ask_for(params, sign, front, friction):
    controller = Controller(friction)
    commands = pushed(controller, controller.most(sign, front), front)
    last = commands[-1]
    beyond = last._replace(
        stamp_ns=last.stamp_ns + TICK_NS, Fxf=1.001 * last.Fxf, Fxr=1.001 * last.Fxr
    )
    assert controller.reason(beyond, last) in ('out_of_range', 'beyond_friction')
    assert passes_both(params, friction, controller, commands) == (True, True)


def test_the_plant_accepts_a_force_that_moves_from_axle_to_axle(params):
    """The controller's gate has no limit for that."""
    controller = Controller(1.0)
    force = max(controller.most(BRAKES, front) for front in (REAR, FRONT))
    commands = pushed(controller, force, REAR)
    for front in (FRONT, REAR):
        last = commands[-1]
        commands.append(command_for(last.stamp_ns + TICK_NS, last.delta, 0.0, force, front))
    assert passes_both(params, 1.0, controller, commands) == (True, True)
