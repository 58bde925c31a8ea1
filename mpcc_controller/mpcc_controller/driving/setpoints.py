"""Set-points of the actuators, and the commands that carry them. SI units."""

from typing import NamedTuple

import numpy as np

from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, Input, State
from mpcc_controller.parameters import Limits
from msgs_yaml.types import Command
from stage_solver.stage_problem import Plan


class Setpoints(NamedTuple):
    """The set-points sent last: the integrated inputs of the paper."""

    delta: float  # rad
    Fx: float  # N


class SetpointTarget(NamedTuple):
    """Set-points at the end of a step, and the brake split."""

    delta: float  # rad
    Fx: float  # N
    lambda_b: float  # -


def target_of_plan(plan: Plan, car: Car, limits: Limits) -> SetpointTarget:
    """Return the set-points at the end of the first step of a plan.

    The plan holds lambda_b over the step while Fx moves; at the end of the step the split must
    still keep both axles within their share of the friction.
    """
    x, u = State(*plan.X[1]), Input(*plan.U[0])
    split = split_within_friction(u.lambda_b, x.Fx, car, limits)
    return SetpointTarget(float(x.delta), float(x.Fx), split)


def split_within_friction(lambda_b: float, Fx: float, car: Car, limits: Limits) -> float:
    """Return the brake split closest to `lambda_b` that overloads neither axle."""
    brake = -min(Fx, 0.0)
    if brake == 0:
        return float(lambda_b)
    Fz = single_track.loads(Fx, car)
    highest = limits.friction_use * car.mu_f * Fz.f / brake
    lowest = 1 - limits.friction_use * car.mu_r * Fz.r / brake
    if lowest > highest:  # the force exceeds the friction of both axles: split it as that is
        return float(car.mu_f * Fz.f / (car.mu_f * Fz.f + car.mu_r * Fz.r))
    return float(np.clip(lambda_b, lowest, highest))


def allowed_split(Fx: float, car: Car, limits: Limits) -> float:
    """Return the ideal front share of a braking force [N], within the limits of the share."""
    share = single_track.ideal_split(Fx, car)
    return min(max(share, limits.brake_front_share_min), limits.brake_front_share_max)


def within_limits(
    delta: float, Fx: float, lambda_b: float, now: Setpoints, limits: Limits, dt: float
) -> SetpointTarget:
    """Return a target with the steering angle [rad] nearest to `delta` within range and rate.

    The force [N] is taken as it is: who splits it between the axles has limited it before.
    """
    steer = limits.steer_rate_radps * dt
    delta = min(max(delta, -limits.steer_rad), limits.steer_rad)
    return SetpointTarget(min(max(delta, now.delta - steer), now.delta + steer), Fx, lambda_b)


def within_rates(
    target: SetpointTarget, now: Setpoints, limits: Limits, dt: float
) -> SetpointTarget:
    """Return the target, or what of it can be reached within `dt` [s]."""
    steer, force = limits.steer_rate_radps * dt, limits.force_rate_nps * dt
    delta = min(max(target.delta, now.delta - steer), now.delta + steer)
    Fx = min(max(target.Fx, now.Fx - force), now.Fx + force)
    return target._replace(delta=delta, Fx=Fx)


def command_to(
    target: SetpointTarget, now: Setpoints, car: Car, dt: float, stamp_ns: int
) -> Command:
    """Return the command that moves the set-points from `now` to `target` within `dt` [s]."""
    F = single_track.split(target.Fx, target.lambda_b, car)
    return Command(
        stamp_ns=stamp_ns,
        delta=target.delta,
        d_delta=(target.delta - now.delta) / dt,
        Fxf=float(F.f),
        Fxr=float(F.r),
    )


def setpoints_of(command: Command, car: Car) -> tuple[Setpoints, float]:
    """Return the set-points that a command leads to, and the front share of its braking."""
    Fx = command.Fxf + command.Fxr
    share = command.Fxf / Fx if Fx < 0 else single_track.ideal_split(Fx, car)
    return Setpoints(command.delta, Fx), float(share)
