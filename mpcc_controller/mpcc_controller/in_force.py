"""The parameters as a controller drives by them, and what of them the car changes. SI units.

Limits are those of the car at most, the brake split may be fixed, the least speed is where the
prediction is stable, circles may cover the outline of the car.

Speeds below or near the least one stop a car. Measured on `straight` with `limits.least_speed_mps`
of 7 m/s: a start at 7 m/s stops, one at 7.05 m/s drives; a car that slows down from 15 m/s to a
desired speed undershoots it, so it stops with a desired speed of 7.4 m/s and drives with 7.6 m/s.

The model is imported where it is needed: CasADi takes a third of a second, and a mistake in the
inputs of a command is to be told at once.
"""

import dataclasses
import math
from typing import Any

import numpy as np

from mpcc_controller import car_file
from mpcc_controller.parameters import FIXED, Body, CarOutline, CarParams, ControllerParams, Limits
from node_runtime.parameters import ParameterError

# of a fixed split: Brown & Gerdes, "Coordinating tire forces to avoid obstacles using nonlinear
# model predictive control", IEEE T-IV 2019, and its predecessors fix 0.6 to 0.7
FRONT_SHARE = 0.65
START_MARGIN_MPS = 0.2  # above the least speed a start may still stop
DESIRED_MARGIN_MPS = 0.5  # the same for a desired speed
ROUNDING_MPS = 0.01  # of a desired speed, which is a distance over a time
# without a least speed: a car that rolls back faster than this is braked
BACKWARDS_MPS = -1.0
BELOW, NEAR = 'below', 'at or just above'


def in_force(params: ControllerParams, vehicle: CarParams) -> ControllerParams:
    """Return the parameters as the controller drives by them.

    Raises ParameterError for options that contradict each other or need what the car file does not
    have, and for a car that cannot be predicted in steps of `model.step_s`.
    """
    params = car_file.limit_to_car(params, vehicle)
    share = params.formulation.brake_front_share
    if params.formulation.brake_split == FIXED:
        share = FRONT_SHARE if share is None else share
        params = _limited(params, brake_front_share_min=share, brake_front_share_max=share)
    elif share is not None:
        raise ParameterError(
            f'formulation.brake_front_share: is {share:g}, but formulation.brake_split is '
            f'free; allowed with {FIXED}'
        )
    return with_covering_circles(with_stable_speed(params, vehicle), vehicle)


def _limited(params: ControllerParams, **limits: Any) -> ControllerParams:
    return dataclasses.replace(params, limits=dataclasses.replace(params.limits, **limits))


def with_stable_speed(params: ControllerParams, vehicle: CarParams) -> ControllerParams:
    """Return the parameters with a least speed from which on the prediction of the car is stable.

    It is 0 where the model holds down to standstill. Raises ParameterError for a car whose
    prediction is not stable at any speed.
    """
    from mpcc_controller.model import stability
    from mpcc_controller.problem import stage_parameters

    if params.model.low_speed:
        params = _limited(params, least_speed_mps=0.0, speed_hysteresis_mps=0.0)
    least, dt = params.limits.least_speed_mps, params.model.step_s
    if not least:
        return params
    stable = stability.least_stable_speed(stage_parameters.car(params, vehicle), dt, least)
    if not math.isfinite(stable):
        raise ParameterError(
            f'model.step_s: is {dt:g}, with which the prediction of the car of car_file '
            f'{params.car_file} is unstable at every speed; allowed shorter steps'
        )
    return _limited(params, least_speed_mps=stable)


def cover(outline: CarOutline, count: int) -> tuple[float, tuple[float, ...]]:
    """Return the radius [m] and the offsets [m ahead of the CoG] of circles over an outline.

    Each circle covers an equal share of the length: its radius is half the diagonal of a rectangle
    as long as the share and as wide as the car.
    """
    half_share = (outline.front_m + outline.rear_m) / (2 * count)
    offsets = -outline.rear_m + half_share * (2 * np.arange(count) + 1)
    return float(np.hypot(half_share, outline.width_m / 2)), tuple(offsets.tolist())


def with_covering_circles(params: ControllerParams, vehicle: CarParams) -> ControllerParams:
    """Return the parameters with the circles that `body.circles` asks for, if it does.

    Beside a centre the car is as wide as it is: at an edge, which is almost parallel to the car,
    half of the width counts. The radius would take away 0.3 m of road on either side.

    Raises ParameterError for a car file without the outline.
    """
    if params.body.circles is None:
        return params
    missing = [name for name, value in dataclasses.asdict(vehicle.outline).items() if value is None]
    if missing:
        raise ParameterError(
            f'body.circles: is {params.body.circles}, but car_file {params.car_file} does not have '
            f'outline.{missing[0]}; allowed with a file of `identify` that has the outline'
        )
    radius, offsets = cover(vehicle.outline, params.body.circles)
    at_edges = params.body.edge_radius_m
    if at_edges is None:
        at_edges = vehicle.outline.width_m / 2
    body = Body(radius, offsets, params.body.circles, at_edges)
    return dataclasses.replace(params, body=body)


def describe_changes(params: ControllerParams, vehicle: CarParams) -> list[str]:
    """Return a line for limits that this car cuts, and one for what its stability changes."""
    from mpcc_controller.model import single_track
    from mpcc_controller.problem import stage_parameters

    cuts = [
        f'limits.{name} from {getattr(params.limits, name):g} to '
        f'{getattr(vehicle.actuators, name):g}'
        for name in car_file.exceeded_limits(params, vehicle.actuators)
    ]
    lines = [
        f'the controller may ask for more than the car of car_file {params.car_file} can do; cut: '
        + ', '.join(cuts)
    ]
    lines = lines if cuts else []
    least = params.limits.least_speed_mps
    stable = with_stable_speed(params, vehicle).limits.least_speed_mps
    kinematic = stage_parameters.car(params, vehicle).kinematic_below
    why = f'below it steps of {params.model.step_s:g} s are unstable on the tyres of the car'
    if stable > least:
        lines.append(f'limits.least_speed_mps is {stable:g} instead of {least:g}: {why}')
    elif kinematic > single_track.BLEND_FROM_MPS:
        lines.append(f'the prediction is kinematic up to {kinematic:g} m/s: {why}')
    return lines


def compare_speed(speed_mps: float, least_mps: float, margin_mps: float) -> str:
    """Return BELOW, NEAR (within the margin above), or '' for a speed that is high enough.

    Without a least speed (0) every speed is.
    """
    if not least_mps:
        return ''
    if speed_mps < least_mps - ROUNDING_MPS:
        return BELOW
    return NEAR if speed_mps <= least_mps + margin_mps + ROUNDING_MPS else ''


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
