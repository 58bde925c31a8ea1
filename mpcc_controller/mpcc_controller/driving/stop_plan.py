"""The set-points that stop the car along its plan when no command follows. SI units.

The plant follows them without a controller, so without any feedback: they use less of the friction
than a command does. From when the plant stops to hold the command they are those of the plan, which
may be about to pass an obstacle, then they brake along its line, in steady cornering.
"""

from dataclasses import replace

import numpy as np

from mpcc_controller.driving import guesses
from mpcc_controller.driving.records import TickRecord
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, State
from mpcc_controller.parameters import ControllerParams
from msgs_yaml.conversions import ns_to_s
from msgs_yaml.types import StopPlan

HELD_TICKS = 2  # for which a plant holds the last command before it follows a stop plan
FOLLOWED_TICKS = 10  # in which they are those of the plan
FRICTION_USE = 0.65  # of the brakes, less what the line needs for cornering; not of cornering
STANDS_MPS = 0.3


def stop_plan(
    record: TickRecord, car: Car, params: ControllerParams, command_ns: int
) -> StopPlan | None:
    """Return the set-points that follow the command of a tick; None if it follows no plan.

    `car` is that on the believed friction, `command_ns` the known delay [ns] of commands.
    """
    plan, command, limits = record.decision.plan, record.command, params.limits
    if plan is None:
        return None
    use = min(FRICTION_USE, limits.friction_use)
    gentle = replace(params, limits=replace(limits, friction_use=use))
    first = 1 + HELD_TICKS
    last = min(first + FOLLOWED_TICKS, len(plan.X) - 2)
    braking = guesses.braking(plan.X[last:], State(*plan.X[last]), car, gentle, floor=0.0)
    states = State(*np.vstack((plan.X[first + 1 : last], braking.X)).T)
    stands = np.flatnonzero(states.vx < STANDS_MPS)
    count = int(stands[0]) if len(stands) else len(states.vx)
    if not count:
        return None
    step_s = params.model.step_s
    delta = _follow(states.delta[:count], command.delta, limits.steer_rate_radps * step_s)
    wanted, held = np.minimum(states.Fx[:count], 0.0), command.Fxf + command.Fxr  # no driving
    force = _follow(wanted, held, limits.force_rate_nps * step_s)
    share = single_track.ideal_split(force, car)
    share = np.clip(share, limits.brake_front_share_min, limits.brake_front_share_max)
    # stage 0 of the plan is where the command takes effect
    begin_s = ns_to_s(record.effective_ns - command_ns - command.stamp_ns)
    return StopPlan(
        stamp_ns=command.stamp_ns,
        t=begin_s + step_s * (first + 1 + np.arange(count)),
        delta=delta,
        Fxf=share * force,
        Fxr=(1 - share) * force,
    )


def _follow(wanted, held, change):
    """Return set-points (n,) near the wanted ones (n,), each within `change` of the one before."""
    points = [held]
    for value in wanted.tolist():
        points.append(min(max(value, points[-1] - change), points[-1] + change))
    return np.array(points[1:])
