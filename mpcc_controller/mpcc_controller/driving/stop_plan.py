"""The set-points that stop the car along its plan when no command follows. SI units.

The plant follows them without a controller, so without any feedback: they use less of the friction
than a command does. From when the plant stops to hold the command they are those of the plan, which
may be about to pass an obstacle, then they brake along its line, in steady cornering.
"""

import math
from dataclasses import replace

import numpy as np

from mpcc_controller.driving import guesses
from mpcc_controller.driving.records import TickRecord
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, State
from mpcc_controller.parameters import ControllerParams
from msgs_yaml import contract
from msgs_yaml.conversions import ns_to_s
from msgs_yaml.types import StopPlan

FOLLOWED_S = 0.5  # in which they are those of the plan
FRICTION_USE = 0.65  # of the brakes, less what the line needs for cornering; not of cornering
STANDS_MPS = 0.3


def stop_plan(
    record: TickRecord, car: Car, params: ControllerParams, command_ns: int
) -> StopPlan | None:
    """Return the set-points that follow the command of a tick; None if it follows no plan.

    `car` is that on the believed friction, `command_ns` their delay [ns], known and found.
    """
    plan, command, limits = record.decision.plan, record.command, params.limits
    if plan is None:
        return None
    use = min(FRICTION_USE, limits.friction_use)
    gentle = replace(params, limits=replace(limits, friction_use=use))
    topic, step_s = contract.load().topics['/controller/command'], params.model.step_s
    tick_s = 1.0 / topic.rate_hz[contract.REALTIME]
    # the plant holds the set-points of the command, due after a tick, and is at the first ones here
    # another tick later: the stages are those of these instants, whatever their length
    first = math.ceil((topic.held_s + 2.0 * tick_s) / step_s - 1e-9)
    last = min(first - 1 + round(FOLLOWED_S / step_s), len(plan.X) - 2)
    braking = guesses.braking(plan.X[last:], State(*plan.X[last]), car, gentle, floor=0.0)
    X = np.vstack((plan.X[:last], braking.X))[first:]
    states = State(*X[np.logical_and.accumulate(X[:, 3] >= STANDS_MPS)].T)
    if not len(states.vx):
        return None
    k = np.arange(len(states.vx))
    dt = np.where(k > 0, step_s, tick_s)
    delta = _follow(states.delta, command.delta, limits.steer_rate_radps * dt)
    wanted, held = np.minimum(states.Fx, 0.0), command.Fxf + command.Fxr  # no driving
    force = _follow(wanted, held, limits.force_rate_nps * dt)
    share = single_track.ideal_split(force, car)
    share = np.clip(share, limits.brake_front_share_min, limits.brake_front_share_max)
    # stage 0 of the plan is where the command takes effect
    begin_s = ns_to_s(record.effective_ns - command_ns - command.stamp_ns)
    return StopPlan(
        stamp_ns=command.stamp_ns,
        t=begin_s + step_s * (first + k),
        delta=delta,
        Fxf=share * force,
        Fxr=(1 - share) * force,
    )


def _follow(wanted, held, change):
    """Return set-points (n,) near the wanted ones, each within its `change` of the one before."""
    points = [held]
    for value, most in zip(wanted.tolist(), change.tolist()):
        points.append(min(max(value, points[-1] - most), points[-1] + most))
    return np.array(points[1:])
