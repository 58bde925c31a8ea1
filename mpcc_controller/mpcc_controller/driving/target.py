"""What the actuators are told to reach within one step, and the command that says so. SI units."""

from typing import NamedTuple

import numpy as np

from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, Input, State
from mpcc_controller.parameters import Limits
from msgs_yaml.types import Command
from stage_solver.stage_problem import Plan


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
