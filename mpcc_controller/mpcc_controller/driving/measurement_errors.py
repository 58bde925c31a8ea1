"""Errors of what a controller measures, for tests of its robustness. SI units.

A controller with errors answers another state and other obstacles than it received. The recording
keeps the truth, from which drives are judged, and a replay makes the same errors again: they follow
from the parameters, the stamp and what was received, and from nothing else.
"""

import math
from types import MappingProxyType, SimpleNamespace

import numpy as np

from mpcc_controller.parameters import CAMERA, LIDAR, TRACKER, MeasurementErrors
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Obstacle, Obstacles, VehicleState

# streams of random numbers, independent of each other
STATE, DROPOUT, POSITION, VELOCITY, GHOST, SWAP = range(6)
DROPOUT_S = 0.05  # duration of a dropout where it is left out: a tick
GHOST_S, SWAP_S = 0.3, 0.5  # duration of a ghost, and of ids that are exchanged
GHOST_IDS = 1_000_000  # from here on
GHOST_AHEAD_M, GHOST_ASIDE_M, GHOST_RADIUS_M = (5.0, 60.0), (-6.0, 6.0), (0.3, 1.0)
_SEEN = {'obstacle_dropout': 0.05, 'obstacle_ghosts': 0.05}  # assumed, of all
# Mean errors in the plane of objects that are found, mATE and mAVE of the nuScenes benchmark on its
# validation set, over 1.2533: the deviations per axis of a normal distribution.
PRESETS = MappingProxyType(
    {
        TRACKER: {'obstacle_noise_m': 0.2, 'obstacle_velocity_noise_mps': 0.5, **_SEEN},
        # CenterPoint, voxels of 0.075 m, as in the README of OpenPCDet: 0.288 m, 0.216 m/s
        LIDAR: {'obstacle_noise_m': 0.23, 'obstacle_velocity_noise_mps': 0.17, **_SEEN},
        # BEVDet-R50, as in its file configs/bevdet/bevdet-r50.py: 0.773 m, 0.864 m/s
        CAMERA: {'obstacle_noise_m': 0.62, 'obstacle_velocity_noise_mps': 0.69, **_SEEN},
    }
)


def in_force(params: MeasurementErrors) -> SimpleNamespace:
    """Return every error; one that is given wins over that of the preset, and none is 0."""
    given = {name: value for name, value in vars(params).items() if value is not None}
    return SimpleNamespace(
        **{**dict.fromkeys(vars(params), 0), **PRESETS.get(params.preset, {}), **given}
    )


def measured_state(truth: VehicleState, params: MeasurementErrors) -> VehicleState:
    """Return the state as it is measured: biases, then white noise per stamp.

    Position and its bias are in the frame of the car. An error of the sideslip angle turns the
    measured velocity against the body; the measured speed keeps its magnitude beside its own error.
    """
    others = ('seed', 'preset')
    values = vars(params).items()
    if not any(v for name, v in values if name not in others and not name.startswith('obstacle')):
        return truth
    stamp_ns, X, Y, psi, vx, vy, r = truth
    e = in_force(params)
    scale, turn = 1 + e.speed_error, e.sideslip_bias_rad
    sin_turn, cos_turn = math.sin(turn), math.cos(turn)
    n = _generator(e, STATE, stamp_ns).standard_normal(6)
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
    on its own. Obstacles are where they were `obstacle_latency_s` ago at their present velocity, of
    which the message tells nothing. The errors of position and velocity are drawn anew with every
    stamp. For a share of the time there is a ghost that stands ahead, and the two obstacles that
    are closest to each other have exchanged their ids.
    """
    e = in_force(params)
    if not any(value for name, value in vars(e).items() if name.startswith('obstacle')):
        return truth
    seen = []
    for o in (*truth.items, *_ghosts(car, stamp_ns, e)):
        # a state that is not finite hides nothing
        nearest = min(math.hypot(d.X - car.X, d.Y - car.Y) for d in o.discs()) - o.r_obs
        if e.obstacle_range_m and nearest > e.obstacle_range_m:
            continue
        if e.obstacle_dropout:
            period_ns = round((e.obstacle_dropout_s or DROPOUT_S) * NS_PER_S)
            draw = _generator(e, DROPOUT, stamp_ns // period_ns, o.id).random()
            if draw < e.obstacle_dropout:
                continue
        dX, dY = e.obstacle_noise_m * _generator(e, POSITION, stamp_ns, o.id).standard_normal(2)
        late = e.obstacle_latency_s
        o = o._replace(X=o.X - late * o.vX + dX, Y=o.Y - late * o.vY + dY)
        if e.obstacle_velocity_noise_mps:
            dX, dY = _generator(e, VELOCITY, stamp_ns, o.id).standard_normal(2)
            scale = e.obstacle_velocity_noise_mps
            o = o._replace(vX=o.vX + scale * dX, vY=o.vY + scale * dY)
        seen.append(o)
    if len(seen) > 1 and _happens(e, SWAP, stamp_ns, SWAP_S, e.obstacle_swaps):
        pairs = [(i, j) for j in range(len(seen)) for i in range(j)]
        i, j = min(pairs, key=lambda p: math.dist(seen[p[0]][1:3], seen[p[1]][1:3]))
        seen[i], seen[j] = seen[i]._replace(id=seen[j].id), seen[j]._replace(id=seen[i].id)
    return truth._replace(items=tuple(seen))


def _ghosts(car, stamp_ns, e):
    """Yield what is seen and is not there: for GHOST_S it stands ahead of where the car was."""
    if not _happens(e, GHOST, stamp_ns, GHOST_S, e.obstacle_ghosts) or not np.all(np.isfinite(car)):
        return
    period, since_ns = divmod(stamp_ns, round(GHOST_S * NS_PER_S))
    shares = _generator(e, GHOST, period, 1).random(3)
    ranges = (GHOST_AHEAD_M, GHOST_ASIDE_M, GHOST_RADIUS_M)
    ahead, left, radius = (a + share * (b - a) for share, (a, b) in zip(shares, ranges))
    # at its present velocity
    ahead, left = ahead - car.vx * since_ns / NS_PER_S, left - car.vy * since_ns / NS_PER_S
    cos, sin = math.cos(car.psi), math.sin(car.psi)
    X, Y = car.X + ahead * cos - left * sin, car.Y + ahead * sin + left * cos
    yield Obstacle(GHOST_IDS + period % GHOST_IDS, float(X), float(Y), float(radius), 0.0, 0.0)


def _happens(e, stream, stamp_ns, period_s, share):
    """Return whether something happens in the period of a stamp, as it does for a share of them."""
    period = stamp_ns // round(period_s * NS_PER_S)
    return bool(share) and _generator(e, stream, period).random() < share


def _generator(params, stream, instant, number=0) -> np.random.Generator:
    """Return random numbers that are a function of the arguments (a counter-based generator)."""
    counter = (0, stream, instant, number % 2**64)
    return np.random.Generator(np.random.Philox(key=params.seed, counter=counter))
