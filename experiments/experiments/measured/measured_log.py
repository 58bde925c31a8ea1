"""A log in SI units at the CoG, at 50 Hz and filtered; what is missing or wrong is marked.

Read are Racelogic VBO, MATLAB 5 to 7, CSV with a header, and bags of ours. Spikes are replaced
where they are short; gaps, longer spikes and a signal that stands still while the car turns are
left out of everything that follows. `Log.notes` says how much that was.

A log that contradicts itself is refused: at small lateral acceleration the yaw rate is near
vx steer / L, whatever the tyres; the measured lateral acceleration is near vx r; and the rear axle
slips away from its force: of both signs of the lateral speed one explains the slip by the force.
"""

import csv
from collections.abc import Mapping
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas
from scipy.io import loadmat
from scipy.ndimage import binary_opening, median_filter, minimum_filter1d, uniform_filter1d
from scipy.signal import butter, sosfiltfilt

from bags.errors import BagError
from bags.storage import read as bags_read
from experiments.measured.log_map import HHMMSS, UNITS, LogMap
from msgs_yaml.strict_yaml import closest

STEP_S = 0.02
LOW_PASS_HZ = 8.0
LEAST_RATE_HZ = 20.0
LONGEST_GAP_STEPS = 2.5  # of the median time between two rows
AROUND_GAP_S = 0.1  # which a filter spoils
SPIKE_WINDOW = 7  # rows of the running median
SPIKE_DEVIATIONS = 8.0 * 1.4826  # median deviations from it: 8 standard deviations
BURST_S, BURST_FACTOR = 0.3, 10.0  # of the median, and of SPIKE_LEAST, for spikes in a row
# at least so far from it: rad, m/s, m/s, rad/s, m/s^2
SPIKE_LEAST = {'steer': 0.04, 'vx': 0.5, 'vy': 0.3, 'yaw_rate': 0.1, 'ax': 3.0, 'ay': 3.0}
MENDED_S = 0.1  # a longer spike is left out
MOST_WRONG = 0.2  # share of the rows
FROZEN_S, FROZEN_ABOVE_RADPS = 0.3, 0.15
LEAST_ROWS = 100
MOST_SHOWN = 40  # columns of a log that an error names
IMU = '/vehicle/imu'  # may be missing in a bag
# of a bag: the columns of its topics
BAG_COLUMNS = {
    bags_read.STATE: {'vx': 'vx_mps', 'vy': 'vy_mps', 'yaw_rate': 'yaw_rate_radps'},
    '/vehicle/actuators': {'steer': 'steer_rad'},
    IMU: {'ax': 'ax_mps2', 'ay': 'ay_mps2'},
}
# of the checks
GENTLE_MPS2, SLOWEST_MPS, FASTEST_MPS = 4.0, 4.0, 90.0
EXCITED_RADPS, TURNING_ROWS = 0.03, 50
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


class Log(NamedTuple):
    """Motion of the CoG, arrays (n,) every `STEP_S`."""

    name: str
    t: np.ndarray  # s
    steer: np.ndarray  # rad at the road wheel
    vx: np.ndarray  # m/s
    vy: np.ndarray  # m/s
    r: np.ndarray  # rad/s
    ax: np.ndarray  # m/s^2, kinematic: dvx/dt - vy r
    ay: np.ndarray  # m/s^2, kinematic: dvy/dt + vx r
    valid: np.ndarray  # bool
    notes: tuple[str, ...]


def load(path: Path, log_map: LogMap) -> Log:
    """Read and prepare a log. Raises BagError, also where `check` refuses it."""
    notes = []
    signals = read(path, log_map)
    if 'time' not in signals:  # rate_hz counts the rows that differ
        repeats = np.all(np.diff([*signals.values()], prepend=np.nan) == 0, axis=0)
        if repeats.any():
            notes.append(f'{repeats.sum()} rows repeat the one before: left out')
        signals = {name: x[~repeats] for name, x in signals.items()}
        signals['time'] = np.arange((~repeats).sum()) / log_map.columns.rate_hz
    t = signals.pop('time')
    if not np.isfinite(t).all() or (np.diff(t) < 0).any():
        raise BagError(f'{path}: time: does not increase from row to row')
    increasing = np.append(True, np.diff(t) > 0)
    t, signals = t[increasing], {name: x[increasing] for name, x in signals.items()}
    step = float(np.median(np.diff(t))) if len(t) > 1 else np.inf
    if step > 1 / LEAST_RATE_HZ:
        raise BagError(f'{path}: time: {1 / step:.3g} rows a second; at least {LEAST_RATE_HZ:g}')

    def longer_than(seconds, marked):
        """Return the marked rows that are in a longer run of them."""
        return binary_opening(marked, np.ones(round(seconds / step) + 1))

    wrong = np.zeros(len(t), bool)
    for name, values in signals.items():
        spikes = _spikes(values, SPIKE_LEAST[name], round(BURST_S / step))
        if spikes.any():
            notes.append(f'{name}: {spikes.sum()} rows of spikes')
            values[spikes] = np.interp(t[spikes], t[~spikes], values[~spikes])
            wrong |= longer_than(MENDED_S, spikes)
    turning = np.abs(signals['yaw_rate']) > FROZEN_ABOVE_RADPS
    for name in ('vy', 'yaw_rate'):
        frozen = longer_than(FROZEN_S, np.append(False, np.diff(signals[name]) == 0)) & turning
        if frozen.any():
            notes.append(f'{name}: stands still for {frozen.sum() * step:.1f} s')
            wrong |= frozen
    gaps = np.flatnonzero(np.diff(t) > LONGEST_GAP_STEPS * step)
    if len(gaps):
        notes.append(f'{len(gaps)} gaps, together {np.diff(t)[gaps].sum():.1f} s')
    if wrong.mean() > MOST_WRONG:
        raise BagError(
            f'{path}: {wrong.mean():.0%} of the rows are wrong ({"; ".join(notes)}); allowed up to '
            f'{MOST_WRONG:.0%}'
        )
    notes += check(path, t, signals, log_map)
    even, grid = np.arange(t[0], t[-1], step), np.arange(t[0], t[-1], STEP_S)
    valid = np.interp(grid, t, wrong) == 0
    for k in gaps:
        valid &= (grid < t[k] - AROUND_GAP_S) | (grid > t[k + 1] + AROUND_GAP_S)
    low_pass = butter(2, min(LOW_PASS_HZ, 0.4 / step), fs=1 / step, output='sos')
    late = {name: getattr(log_map.columns.signals, name).late_s or 0.0 for name in signals}
    steer, vx, vy, r = (
        sosfiltfilt(low_pass, np.interp(even + late[name], t, signals[name]))
        for name in ('steer', 'vx', 'vy', 'yaw_rate')
    )
    sensor = log_map.columns.sensor
    vx = vx + (sensor.left_m or 0.0) * r
    vy = vy - (sensor.ahead_m or 0.0) * r
    ax, ay = np.gradient(vx, step) - vy * r, np.gradient(vy, step) + vx * r
    columns = (np.interp(grid, even, x) for x in (steer, vx, vy, r, ax, ay))
    return Log(path.name, grid - t[0], *columns, valid, tuple(notes))


def _spikes(values, least, burst):
    missing = ~np.isfinite(values)
    if missing.all():
        return missing
    values = np.where(missing, np.nanmedian(values), values)
    away = np.abs(values - median_filter(values, SPIKE_WINDOW, mode='nearest'))
    far = np.abs(values - median_filter(values, burst, mode='nearest')) > BURST_FACTOR * least
    return missing | far | (away > max(least, SPIKE_DEVIATIONS * float(np.median(away))))


def read(path: Path, log_map: LogMap) -> dict[str, np.ndarray]:
    """Return the signals of `UNITS` that a log has, SI, ISO 8855 axes, arrays (n,).

    Raises BagError that names the file and the signal, and OSError.
    """
    reader = {'.vbo': _read_vbo, '.mat': _read_mat, '.csv': _read_csv}.get(path.suffix.lower())
    if reader is None:
        return _read_bag(path)
    try:
        columns = reader(path)
    except (ValueError, TypeError, NotImplementedError, csv.Error) as error:
        raise BagError(f'{path}: cannot be read as {path.suffix[1:]}: {error}') from None
    wanted, signals = log_map.columns, {}
    for name, units in UNITS.items():
        signal = getattr(wanted.signals, name)
        if not signal.column:
            continue
        if signal.column not in columns:
            shown = ', '.join([*columns][:MOST_SHOWN])
            hint = closest(signal.column, columns) or f'; it has {shown}'
            raise BagError(f'{path}: {name}: there is no column {signal.column!r}{hint}')
        values = np.asarray(columns[signal.column], float)
        if signal.unit == HHMMSS:
            values = values // 1e4 * 3600 + values // 100 % 100 * 60 + values % 100
        signals[name] = (signal.sign or 1) * units[signal.unit] * values
    if 'sideslip' in signals and 'vx' in signals:
        signals['vy'] = signals['vx'] * np.tan(signals.pop('sideslip'))
    for name in ('steer', 'vx', 'yaw_rate', 'vy'):
        if name not in signals:
            raise BagError(f'{path}: signals.{name}: is missing; the map says which column it is')
    if len(signals['vx']) < LEAST_ROWS:
        raise BagError(f'{path}: has {len(signals["vx"])} rows; at least {LEAST_ROWS}')
    if 'time' not in signals and wanted.rate_hz is None:
        raise BagError(f'{path}: the map has neither signals.time nor rate_hz')
    signals['steer'] = signals['steer'] / (wanted.steering_ratio or 1.0)
    return signals


def _numbers(frame):
    return frame.apply(pandas.to_numeric, errors='coerce')


def _read_vbo(path):
    names, data = (
        path.read_text(encoding='latin-1').partition(f'[{section}]')[2]
        for section in ('column names', 'data')
    )
    names = names.partition('[')[0].split()
    if not names or not data:
        raise ValueError('sections [column names] and [data] are missing')
    rows = pandas.read_csv(StringIO(data), sep=r'\s+', names=names, index_col=False)
    return _numbers(rows).dropna()  # a file ends where the logger lost its power


def _read_mat(path):
    content = loadmat(path, squeeze_me=True).items()
    columns = {n: x for n, x in content if isinstance(x, np.ndarray) and x.dtype.kind in 'iuf'}
    longest = max((x.size for x in columns.values()), default=0)
    return {name: x for name, x in columns.items() if x.shape == (longest,)}


def _read_csv(path):
    frame = pandas.read_csv(path, sep=None, engine='python', skipinitialspace=True)
    return _numbers(frame).dropna(axis=1, how='all').rename(columns=lambda name: str(name).strip())


def _read_bag(path):
    tables = bags_read.columns(path)
    for topic, columns in BAG_COLUMNS.items():
        if topic not in tables and topic != IMU:
            names = ', '.join(columns)
            raise BagError(f'{path}: nothing was recorded of {topic}, which has {names}')
    t = tables[bags_read.STATE].t_s
    return {'time': t} | {
        name: np.interp(t, tables[topic].t_s, getattr(tables[topic], column))
        for topic, columns in BAG_COLUMNS.items()
        if topic in tables
        for name, column in columns.items()
    }


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
    rows = gentle & turning if (gentle & turning).sum() >= TURNING_ROWS else turning
    if rows.sum() < TURNING_ROWS:
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
    if rows.sum() < TURNING_ROWS:
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
