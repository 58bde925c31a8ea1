"""Errors of what a controller measures, for tests of its robustness. SI units.

A controller with errors answers another state and other obstacles than it received. The recording
keeps the truth, from which drives are judged, and a replay makes the same errors again: they follow
from the parameters, the stamp and what was received, and from nothing else.
"""

import math
from types import SimpleNamespace

import numpy as np

from mpcc_controller.parameters import MeasurementErrors
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Obstacles, VehicleState

# streams of random numbers, independent of each other
STATE, DROPOUT, POSITION = range(3)
DROPOUT_S = 0.05  # duration of a dropout where it is left out: a tick


def measured_state(truth: VehicleState, params: MeasurementErrors) -> VehicleState:
    """Return the state as it is measured: biases, then white noise per stamp.

    Position and its bias are in the frame of the car. An error of the sideslip angle turns the
    measured velocity against the body; the measured speed keeps its magnitude beside its own error.
    """
    values = vars(params).items()
    if not any(v for name, v in values if name != 'seed' and not name.startswith('obstacle')):
        return truth
    stamp_ns, X, Y, psi, vx, vy, r = truth
    e = SimpleNamespace(**{name: value or 0 for name, value in values})
    scale, turn = 1 + e.speed_error, e.sideslip_bias_rad
    sin_turn, cos_turn = math.sin(turn), math.cos(turn)
    n = _generator(params, STATE, stamp_ns).standard_normal(6)
    ahead = e.ahead_bias_m + e.position_noise_m * n[0]
    left = e.left_bias_m + e.position_noise_m * n[1]
    return VehicleState(
        stamp_ns,
        X=X + ahead * np.cos(psi) - left * np.sin(psi),
        Y=Y + ahead * np.sin(psi) + left * np.cos(psi),
        psi=psi + e.yaw_bias_rad + e.yaw_noise_rad * n[2],
        vx=scale * (vx * cos_turn - vy * sin_turn) + e.speed_noise_mps * n[3],
        vy=scale * (vx * sin_turn + vy * cos_turn) + e.lateral_speed_noise_mps * n[4],
        r=r + e.yaw_rate_noise_radps * n[5],
    )


def measured_obstacles(
    truth: Obstacles, car: VehicleState, stamp_ns: int, params: MeasurementErrors
) -> Obstacles:
    """Return the obstacles that are seen at an instant from the true state of the car.

    One beyond the range is not seen. Dropouts last `obstacle_dropout_s` each and hit every obstacle
    on its own. The error of a position is drawn anew with every stamp.
    """
    range_m, noise = params.obstacle_range_m, params.obstacle_noise_m or 0
    if not (params.obstacle_dropout or range_m or noise):
        return truth
    seen = []
    for o in truth.items:
        # a state that is not finite hides nothing
        nearest = min(math.hypot(d.X - car.X, d.Y - car.Y) for d in o.discs()) - o.r_obs
        if range_m and nearest > range_m:
            continue
        if params.obstacle_dropout:
            period_ns = round((params.obstacle_dropout_s or DROPOUT_S) * NS_PER_S)
            draw = _generator(params, DROPOUT, stamp_ns // period_ns, o.id).random()
            if draw < params.obstacle_dropout:
                continue
        dX, dY = noise * _generator(params, POSITION, stamp_ns, o.id).standard_normal(2)
        seen.append(o._replace(X=o.X + dX, Y=o.Y + dY))
    return truth._replace(items=tuple(seen))


def _generator(params, stream, instant, number=0) -> np.random.Generator:
    """Return random numbers that are a function of the arguments (a counter-based generator)."""
    counter = (0, stream, instant, number % 2**64)
    return np.random.Generator(np.random.Philox(key=params.seed or 0, counter=counter))
