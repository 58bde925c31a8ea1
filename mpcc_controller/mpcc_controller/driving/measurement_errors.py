"""Errors of what a controller measures, for tests of its robustness. SI units.

A controller with errors answers another state and other obstacles than it received. The recording
keeps the truth, from which drives are judged, and a replay makes the same errors again: they follow
from the parameters, the stamp and what was received, and from nothing else.
"""

import math

import numpy as np

from mpcc_controller.parameters import MeasurementErrors
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Obstacle, Obstacles, VehicleState

# streams of random numbers, independent of each other
STATE, DROPOUT, POSITION = range(3)
DROPOUT_S = 0.05  # duration of a dropout where it is left out: a tick


def measured_state(truth: VehicleState, params: MeasurementErrors) -> VehicleState:
    """Return the state as it is measured: biases, then white noise per stamp.

    Position and its bias are in the frame of the car. An error of the sideslip angle turns the
    measured velocity against the body; the measured speed keeps its magnitude beside its own error.
    """
    if not _has_state_errors(params):
        return truth
    stamp_ns, X, Y, psi, vx, vy, r = truth
    ahead, left = _or_0(params.ahead_bias_m), _or_0(params.left_bias_m)
    scale, turn = 1 + _or_0(params.speed_error), _or_0(params.sideslip_bias_rad)
    sin_turn, cos_turn = math.sin(turn), math.cos(turn)
    n = _normal(params, STATE, stamp_ns, 6)
    position, lateral = _or_0(params.position_noise_m), _or_0(params.lateral_speed_noise_mps)
    ahead, left = ahead + position * n[0], left + position * n[1]
    return VehicleState(
        stamp_ns,
        X=X + ahead * np.cos(psi) - left * np.sin(psi),
        Y=Y + ahead * np.sin(psi) + left * np.cos(psi),
        psi=psi + _or_0(params.yaw_bias_rad) + _or_0(params.yaw_noise_rad) * n[2],
        vx=scale * (vx * cos_turn - vy * sin_turn) + _or_0(params.speed_noise_mps) * n[3],
        vy=scale * (vx * sin_turn + vy * cos_turn) + lateral * n[4],
        r=r + _or_0(params.yaw_rate_noise_radps) * n[5],
    )


def measured_obstacles(
    truth: Obstacles, car: VehicleState, stamp_ns: int, params: MeasurementErrors
) -> Obstacles:
    """Return the obstacles that are seen at an instant from the true state of the car.

    One beyond the range is not seen. Dropouts last `obstacle_dropout_s` each and hit every obstacle
    on its own. The error of a position is drawn anew with every stamp.
    """
    if not (params.obstacle_dropout or params.obstacle_range_m or params.obstacle_noise_m):
        return truth
    seen = (o for o in truth.items if _is_seen(o, car, stamp_ns, params))
    return truth._replace(items=tuple(_displaced(o, stamp_ns, params) for o in seen))


def _has_state_errors(params):
    return any(
        (
            params.ahead_bias_m,
            params.left_bias_m,
            params.yaw_bias_rad,
            params.speed_error,
            params.sideslip_bias_rad,
            params.position_noise_m,
            params.yaw_noise_rad,
            params.speed_noise_mps,
            params.lateral_speed_noise_mps,
            params.yaw_rate_noise_radps,
        )
    )


def _is_seen(obstacle: Obstacle, car, stamp_ns, params):
    range_m = params.obstacle_range_m
    # a state that is not finite hides nothing
    if range_m and math.hypot(obstacle.X - car.X, obstacle.Y - car.Y) - obstacle.r_obs > range_m:
        return False
    if not params.obstacle_dropout:
        return True
    period_ns = round((params.obstacle_dropout_s or DROPOUT_S) * NS_PER_S)
    draw = _generator(params, DROPOUT, stamp_ns // period_ns, obstacle.id).random()
    return draw >= params.obstacle_dropout


def _displaced(obstacle: Obstacle, stamp_ns, params):
    noise = _or_0(params.obstacle_noise_m)
    dX, dY = noise * _normal(params, POSITION, stamp_ns, 2, obstacle.id)
    return obstacle._replace(X=obstacle.X + dX, Y=obstacle.Y + dY)


def _normal(params, stream, instant, count, number=0):
    return _generator(params, stream, instant, number).standard_normal(count)


def _generator(params, stream, instant, number) -> np.random.Generator:
    """Return random numbers that are a function of the arguments (a counter-based generator)."""
    counter = (0, stream, instant, number % 2**64)
    return np.random.Generator(np.random.Philox(key=_or_0(params.seed), counter=counter))


def _or_0(value):
    return value or 0
