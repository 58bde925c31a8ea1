"""What the actuators are told to reach within one step, from a plan or from plain braking. SI."""

from typing import NamedTuple

import numpy as np

from mpcc_controller import single_track
from mpcc_controller.parameters import Limits
from mpcc_controller.shooting import Plan
from mpcc_controller.single_track import GRAVITY, Car, Input, State
from msgs_yaml.types import Command, VehicleState


class SetPoints(NamedTuple):
    """Where the actuators were last told to be: the integrated inputs of the paper."""

    delta: float  # rad
    Fx: float  # N


class Target(NamedTuple):
    """Set-points at the end of a step."""

    delta: float  # rad
    Fx: float  # N
    lambda_b: float  # -


def of_plan(plan: Plan, car: Car, limits: Limits) -> Target:
    """Return the set-points of the plan's first step.

    The plan holds lambda_b over the step while Fx moves; at the end of it the split must still
    keep both axles inside their share of the friction.
    """
    x, u = State(*plan.X[1]), Input(*plan.U[0])
    return Target(float(x.delta), float(x.Fx), within_friction(u.lambda_b, x.Fx, car, limits))


def within_friction(lambda_b: float, Fx: float, car: Car, limits: Limits) -> float:
    """Return the brake split nearest to `lambda_b` at which neither axle is asked too much."""
    brake = -min(Fx, 0.0)
    if brake == 0:
        return float(lambda_b)
    Fz = single_track.loads(Fx, car)
    most = limits.friction_use * car.mu_f * Fz.f / brake
    least = 1 - limits.friction_use * car.mu_r * Fz.r / brake
    if least > most:  # more force than both axles hold: share it as their friction
        return float(car.mu_f * Fz.f / (car.mu_f * Fz.f + car.mu_r * Fz.r))
    return float(np.clip(lambda_b, least, most))


def braking(x: VehicleState, now: SetPoints, car: Car, limits: Limits, dt: float) -> Target:
    """Return straight braking as hard as the friction beside the lateral force allows.

    The steering goes to zero and the force to its limit, both at their rate limits.
    """
    mu = limits.friction_use * min(car.mu_f, car.mu_r)
    lateral = min(abs(x.vx * x.r) / GRAVITY, mu) if np.isfinite(x.vx * x.r) else 0.0
    hardest = -min(np.sqrt(mu**2 - lateral**2) * car.m * GRAVITY, limits.brake_n)
    turn, push = limits.steer_rate_radps * dt, limits.force_rate_nps * dt
    Fx = float(np.clip(hardest, now.Fx - push, now.Fx + push))
    split = np.clip(
        single_track.ideal_split(Fx, car),
        limits.brake_front_share_min,
        limits.brake_front_share_max,
    )
    return Target(
        delta=float(now.delta - np.clip(now.delta, -turn, turn)),
        Fx=Fx,
        lambda_b=within_friction(split, Fx, car, limits),
    )


def command(target: Target, now: SetPoints, car: Car, dt: float, stamp_ns: int) -> Command:
    """Return the command that carries the set-points from `now` to `target`."""
    F = single_track.split(target.Fx, target.lambda_b, car)
    return Command(
        stamp_ns=stamp_ns,
        delta=target.delta,
        d_delta=(target.delta - now.delta) / dt,
        Fxf=float(F.f),
        Fxr=float(F.r),
    )
