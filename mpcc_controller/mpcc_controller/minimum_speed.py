"""Speeds at which a controller stops instead of driving: below or near its minimum speed.

Measured on `straight` with `limits.least_speed_mps` of 7 m/s: a start at 7 m/s stops, one at
7.05 m/s drives; a car that slows down from 15 m/s to a desired speed undershoots it, so it stops
with a desired speed of 7.4 m/s and drives with 7.6 m/s.

The model is imported where it is needed: CasADi takes a third of a second, and a mistake in the
inputs of a command is to be told at once.
"""

import dataclasses
import math
from functools import lru_cache

from mpcc_controller.parameters import CarParams, ControllerParams, Limits
from node_runtime.parameters import ParameterError

START_MARGIN_MPS = 0.2  # above the minimum speed a start may still stop
DESIRED_MARGIN_MPS = 0.5  # the same for a desired speed
ROUNDING_MPS = 0.01  # of a desired speed, which is a distance over a time
# without a minimum speed: a car that rolls back faster than this is braked
BACKWARDS_MPS = -1.0

BELOW, NEAR = 'below', 'at or just above'


def with_low_speed(params: ControllerParams) -> ControllerParams:
    """Return the parameters with a least speed of 0 where the model holds down to standstill."""
    if not params.model.low_speed:
        return params
    limits = dataclasses.replace(params.limits, least_speed_mps=0.0, speed_hysteresis_mps=0.0)
    return dataclasses.replace(params, limits=limits)


def with_stable_speed(params: ControllerParams, vehicle: CarParams) -> ControllerParams:
    """Return the parameters with a least speed from which on the prediction of the car is stable.

    Raises ParameterError for a car whose prediction is not stable at any speed.
    """
    from mpcc_controller.problem import stage_parameters

    least, dt = params.limits.least_speed_mps, params.model.step_s
    if not least:
        return params
    stable = _stable_speed(stage_parameters.car(params, vehicle), dt, least)
    if not math.isfinite(stable):
        raise ParameterError(
            f'model.step_s: is {dt:g}, with which the prediction of the car of car_file '
            f'{params.car_file} is unstable at every speed; allowed shorter steps'
        )
    limits = dataclasses.replace(params.limits, least_speed_mps=stable)
    return dataclasses.replace(params, limits=limits)


@lru_cache
def _stable_speed(car, dt, least):
    from mpcc_controller.model import stability

    return stability.least_stable_speed(car, dt, least)


def describe_raised(params: ControllerParams, vehicle: CarParams) -> str:
    """Return one line about what the stability of this car changes, '' for nothing."""
    from mpcc_controller.model import single_track
    from mpcc_controller.problem import stage_parameters

    asked = with_low_speed(params)
    least = asked.limits.least_speed_mps
    stable = with_stable_speed(asked, vehicle).limits.least_speed_mps
    why = f'below it steps of {params.model.step_s:g} s are unstable on the tyres of the car'
    if stable > least:
        return f'limits.least_speed_mps is {stable:g} instead of {least:g}: {why}'
    kinematic = stage_parameters.car(params, vehicle).kinematic_below
    if kinematic > single_track.BLEND_FROM_MPS:
        return f'the prediction is kinematic up to {kinematic:g} m/s: {why}'
    return ''


def compare(speed_mps: float, minimum_mps: float, margin_mps: float) -> str:
    """Return BELOW, NEAR (within the margin above), or '' for a speed that is high enough.

    Without a minimum (0) every speed is.
    """
    if not minimum_mps:
        return ''
    if speed_mps < minimum_mps - ROUNDING_MPS:
        return BELOW
    return NEAR if speed_mps <= minimum_mps + margin_mps + ROUNDING_MPS else ''


def least_driven(limits: Limits) -> float:
    """Return the speed [m/s] below which a car brakes to a stop; it may roll back a little."""
    return limits.least_speed_mps or BACKWARDS_MPS


def stopping_text(limits: Limits) -> str:
    """Return why a car below `least_driven` brakes to a stop, and when it drives on."""
    if not limits.least_speed_mps:
        return f'braking to a stop: rolls back faster than {-BACKWARDS_MPS:g} m/s'
    return (
        f'braking to a stop: slower than limits.least_speed_mps, {limits.least_speed_mps:g} '
        f'm/s; driven on only from {limits.least_speed_mps + limits.speed_hysteresis_mps:g} m/s'
    )
