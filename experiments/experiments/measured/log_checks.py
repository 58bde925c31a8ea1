"""Does a log contradict itself? Signs and units, by what a car on a road can do.

At small lateral acceleration the yaw rate is near vx steer / L, whatever the tyres; the measured
lateral acceleration is near vx r; and the rear axle slips away from its force: of both signs of the
lateral speed one explains the slip by the force.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.ndimage import minimum_filter1d, uniform_filter1d

from bags.errors import BagError
from experiments.measured.log_map import LogMap

GENTLE_MPS2, SLOWEST_MPS, FASTEST_MPS = 4.0, 4.0, 90.0
EXCITED_RADPS, LEAST_ROWS = 0.03, 50
GAIN = (0.15, 2.5)  # of vx steer / L, understeer and lag included
AY_GAIN = (0.6, 1.5)  # of vx r
GREATEST_MPS2 = 16.0  # of vx r, of a road car
LATEST_S = 0.3  # the car follows its steering, and recorders have delays
# of a gain: what it is when a unit or the ratio is wrong
MISTAKES = {
    3.6: 'a speed in km/h read as m/s, or the other way round',
    57.3: 'degrees read as radians, or the other way round',
}
STEER_MISTAKES = MISTAKES | {16.0: 'the steering ratio left out or doubly applied'}
AY_MISTAKES = MISTAKES | {9.81: 'g read as m/s^2, or the other way round'}
TELLING = 0.6  # correlation from which on a gain is judged
SUSTAINED_S = 1.0  # of gentle driving
# a slower car's lateral speed is mostly that of rolling, whatever its tyres
SLIPPING_MPS = 15.0
CLEAR = 1.3  # how much better the other sign of vy explains the rear slip


def check(
    path: Path, t: np.ndarray, signals: Mapping[str, np.ndarray], log_map: LogMap
) -> list[str]:
    """Raise BagError where signs or units of a log (SI) cannot be right; it names the signal.

    Returns what could not be checked.
    """
    vx, r = signals['vx'], signals['yaw_rate']
    body, step = log_map.car.car, float(np.median(np.diff(t)))
    if np.median(vx) < 0:
        raise BagError(f'{path}: vx: is negative most of the time; set sign: -1 in the map')
    if not SLOWEST_MPS <= np.quantile(vx, 0.99) <= FASTEST_MPS:
        allowed = f'a car drives {SLOWEST_MPS:g} to {FASTEST_MPS:g}'
        raise BagError(f'{path}: vx: up to {vx.max():.3g} m/s; {allowed}: is its unit right?')
    steer = np.tan(np.clip(signals['steer'], -1, 1))
    geometric = vx * steer / (body.cog_to_front_m + body.cog_to_rear_m)
    gentle = (vx > SLOWEST_MPS) & (np.abs(vx * r) < GENTLE_MPS2)
    gentle = minimum_filter1d(gentle, max(round(SUSTAINED_S / step), 1))
    turning = np.maximum(np.abs(r), np.abs(geometric)) > EXCITED_RADPS
    turning &= vx > SLOWEST_MPS
    # wrong units may have hidden the gentle driving
    rows = gentle & turning if (gentle & turning).sum() >= LEAST_ROWS else turning
    if rows.sum() < LEAST_ROWS:
        raise BagError(f'{path}: yaw_rate, steer: the car hardly turns: nothing to learn')
    for name, values in (('steer', geometric), ('yaw_rate', r)):
        if np.std(values[rows]) < 1e-3 * EXCITED_RADPS:
            raise BagError(f'{path}: {name}: does not change while the car turns')
    fastest = float(np.quantile(np.abs(vx * r), 0.995))
    if fastest > GREATEST_MPS2:
        raise BagError(
            f'{path}: vx yaw_rate: up to {fastest:.0f} m/s^2; a car reaches {GREATEST_MPS2:g}: are '
            'the units of vx and yaw_rate right?'
        )
    # at the delay at which they agree best
    delays = range(0, max(round(LATEST_S / step), 1), max(round(0.02 / step), 1))
    gains = (_gain(np.roll(geometric, delay), r, rows) for delay in delays)
    best = max(gains, key=lambda pair: abs(pair[1]))
    unknown = _judge(path, 'yaw_rate over vx steer / L', *best, *GAIN, STEER_MISTAKES)
    if 'ay' in signals:
        gain = _gain(vx * r, signals['ay'], turning)
        unknown += _judge(path, 'ay over vx yaw_rate', *gain, *AY_GAIN, AY_MISTAKES)
    return unknown + _check_lateral_sign(path, t, step, signals, log_map)


def _gain(x, y, rows):
    """Return the gain of y over x, and their correlation."""
    x, y = x[rows], y[rows]
    power = float(np.sqrt((x @ x) * (y @ y)))
    return (float(x @ y / (x @ x)), float(x @ y / power)) if power else (0.0, 0.0)


def _judge(path, what, gain, correlation, low, high, mistakes):
    if abs(correlation) < TELLING:
        return [f'{what}: not checked, correlation {correlation:.2f}']
    if gain < 0:
        raise BagError(
            f'{path}: {what} is {gain:.3g}, negative: one of them has the wrong sign (left and '
            'turning left are positive); set sign: -1 in the map'
        )
    if low <= gain <= high:
        return []
    near = min(mistakes, key=lambda factor: abs(abs(np.log(gain)) - np.log(factor)))
    raise BagError(
        f'{path}: {what} is {gain:.3g}; a car has {low:g} to {high:g}: as with {mistakes[near]}'
    )


def _check_lateral_sign(path, t, step, signals, log_map):
    body, ahead = log_map.car.car, log_map.columns.sensor.ahead_m or 0.0
    window = max(round(0.1 / step), 1)
    vx, vy, r = (uniform_filter1d(signals[n], window) for n in ('vx', 'vy', 'yaw_rate'))
    rows = (vx > SLIPPING_MPS) & (np.abs(r) > EXCITED_RADPS)
    if rows.sum() < LEAST_ROWS:
        return [f'sign of vy: not checked, the car turns below {SLIPPING_MPS:g} m/s only']
    unexplained = []  # share of the slip that the force does not explain
    for vy_cog in (vy - ahead * r, -vy - ahead * r):
        moment = body.mass_kg * body.cog_to_front_m * (np.gradient(vy_cog, t) + vx * r)
        force = moment - body.yaw_inertia_kgm2 * np.gradient(r, t)
        slip = (vy_cog - body.cog_to_rear_m * r) / np.maximum(vx, SLOWEST_MPS)
        gain, correlation = _gain(force, slip, rows)
        unexplained.append(np.sqrt(1 - correlation**2) if gain < 0 else 1.0)
    if unexplained[0] > CLEAR * unexplained[1]:
        raise BagError(
            f'{path}: vy: with the other sign the rear axle slips as its force demands, with this '
            'one it does not; set sign: -1 in the map (left is positive)'
        )
    return []
