"""A log in SI units at the CoG, at 50 Hz and filtered; what is missing or wrong is marked.

Read are Racelogic VBO, MATLAB 5 to 7, CSV with a header, and bags of ours. Spikes are replaced
where they are short; gaps, longer spikes and a signal that stands still while the car turns are
left out of everything that follows. `Log.notes` says how much that was.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from bags.errors import BagError
from bags.storage import read as bags_read
from experiments.measured import log_checks
from experiments.measured.log_map import HHMMSS, SI, LogMap, Signals
from msgs_yaml.strict_yaml import closest

STEP_S = 0.02
LOW_PASS_HZ = 8.0
LEAST_RATE_HZ = 20.0
LONGEST_GAP_STEPS = 2.5  # of the median time between two rows
AROUND_GAP_S = 0.1  # which a filter spoils
SPIKE_WINDOW = 7  # rows of the running median
SPIKE_DEVIATIONS = 8.0  # robust standard deviations from it
BURST_S, BURST_FACTOR = 0.3, 10.0  # of the median, and of SPIKE_LEAST, for spikes in a row
# at least so far from it: rad, m/s, m/s, rad/s, m/s^2
SPIKE_LEAST = {'steer': 0.04, 'vx': 0.5, 'vy': 0.3, 'yaw_rate': 0.1, 'ax': 3.0, 'ay': 3.0}
MENDED_S = 0.1  # a longer spike is left out
MOST_WRONG = 0.2  # share of the rows
FROZEN_S, FROZEN_ABOVE_RADPS = 0.3, 0.15
NORMAL_MAD = 1.4826
LEAST_ROWS = 100
# of a bag: topic and column
BAG_COLUMNS = {
    'steer': ('/vehicle/actuators', 'steer_rad'),
    'vx': ('/vehicle/odometry', 'vx_mps'),
    'vy': ('/vehicle/odometry', 'vy_mps'),
    'yaw_rate': ('/vehicle/odometry', 'yaw_rate_radps'),
    'ax': ('/vehicle/imu', 'ax_mps2'),
    'ay': ('/vehicle/imu', 'ay_mps2'),
}
NEEDED = ('steer', 'vx', 'yaw_rate')


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


def load(path: Path, log_map: LogMap, checked: bool = True) -> Log:
    """Read and prepare a log. Raises BagError, as `log_checks` unless not `checked`."""
    signals, notes = read(path, log_map), []
    signals = {name: np.array(values, float) for name, values in signals.items()}
    signals, every = _without_repeats(signals)
    if every > 1:
        notes.append(f'every row {every} times: one of them used')
    t = signals.pop('time', None)
    if t is None:
        t = np.arange(len(signals['vx'])) / log_map.columns.rate_hz
    if not np.isfinite(t).all() or (np.diff(t) < 0).any():
        raise BagError(f'{path}: time: does not increase from row to row')
    increasing = np.append(True, np.diff(t) > 0)
    t, signals = t[increasing], {name: x[increasing] for name, x in signals.items()}
    step = float(np.median(np.diff(t))) if len(t) > 1 else np.inf
    if step > 1 / LEAST_RATE_HZ:
        raise BagError(f'{path}: time: {1 / step:.3g} rows a second; at least {LEAST_RATE_HZ:g}')
    wrong = np.zeros(len(t), bool)
    for name, values in signals.items():
        spikes = _spikes(values, SPIKE_LEAST[name], round(BURST_S / step))
        if spikes.any():
            notes.append(f'{name}: {spikes.sum()} rows of spikes')
            values[spikes] = np.interp(t[spikes], t[~spikes], values[~spikes])
            wrong |= _longer_than(spikes, round(MENDED_S / step))
    turning = np.abs(signals['yaw_rate']) > FROZEN_ABOVE_RADPS
    for name in ('vy', 'yaw_rate'):
        still = np.append(False, np.diff(signals[name]) == 0)
        frozen = _longer_than(still, round(FROZEN_S / step)) & turning
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
    if checked:
        notes += log_checks.check(path, t, signals, log_map)
    return _at_cog(path.name, t, signals, wrong, gaps, step, log_map, notes)


def _at_cog(name, t, signals, wrong, gaps, step, log_map, notes):
    from scipy.signal import butter, sosfiltfilt

    even = np.arange(t[0], t[-1], step)
    grid = np.arange(t[0], t[-1], STEP_S)
    cutoff = min(LOW_PASS_HZ, 0.4 / step)
    low_pass = butter(2, cutoff, fs=1 / step, output='sos')

    steer, vx, vy, r = (
        sosfiltfilt(low_pass, np.interp(even, t, signals[n]))
        for n in ('steer', 'vx', 'vy', 'yaw_rate')
    )
    sensor = log_map.columns.sensor
    vx = vx + (sensor.left_m or 0.0) * r
    vy = vy - (sensor.ahead_m or 0.0) * r
    ax, ay = np.gradient(vx, step) - vy * r, np.gradient(vy, step) + vx * r
    valid = np.interp(grid, t, wrong) == 0
    for k in gaps:
        valid &= (grid < t[k] - AROUND_GAP_S) | (grid > t[k + 1] + AROUND_GAP_S)
    steer, vx, vy, r, ax, ay = (np.interp(grid, even, x) for x in (steer, vx, vy, r, ax, ay))
    return Log(name, grid - t[0], steer, vx, vy, r, ax, ay, valid, tuple(notes))


def _without_repeats(signals):
    """Return every k-th row of a log that repeats each row k times, and k."""
    rows = np.column_stack([x for name, x in signals.items() if name != 'time'])
    changes = np.flatnonzero(np.any(np.diff(rows, axis=0) != 0, axis=1))
    every = int(np.median(np.diff(changes))) if len(changes) > 2 else 1
    if every < 2:
        return signals, 1
    # the first row of each repetition
    start = changes[len(changes) // 2] + 1
    return {name: x[start % every :: every] for name, x in signals.items()}, every


def _spikes(values, least, burst):
    from scipy.ndimage import median_filter

    missing = ~np.isfinite(values)
    if missing.all():
        return missing
    values = np.where(missing, np.nanmedian(values), values)
    away = np.abs(values - median_filter(values, SPIKE_WINDOW, mode='nearest'))
    far = np.abs(values - median_filter(values, burst, mode='nearest')) > BURST_FACTOR * least
    limit = max(least, SPIKE_DEVIATIONS * NORMAL_MAD * float(np.median(away)))
    return missing | far | (away > limit)


def _longer_than(marked, count):
    """Return the marked rows that are in a run of more than `count`."""
    kept = np.zeros(len(marked), bool)
    for start, end in stretches(marked):
        kept[start:end] = end - start > count
    return kept


def stretches(valid: np.ndarray) -> list[tuple[int, int]]:
    """Return (first, one past the last) of each run of true rows."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], valid.astype(int), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def read(path: Path, log_map: LogMap) -> dict[str, np.ndarray]:
    """Return the signals of `Signals` that a log has, SI, ISO 8855 axes, arrays (n,).

    Raises BagError that names the file and the signal, and OSError.
    """
    reader = {'.vbo': _read_vbo, '.mat': _read_mat, '.csv': _read_csv}.get(path.suffix.lower())
    if reader is None:
        return _read_bag(path)
    columns, wanted = reader(path), log_map.columns
    signals: dict[str, np.ndarray] = {}
    for name in Signals.__dataclass_fields__:
        signal = getattr(wanted.signals, name)
        if not signal.column:
            continue
        if signal.column not in columns:
            hint = closest(signal.column, columns) or f'; it has {", ".join([*columns][:40])}'
            raise BagError(f'{path}: {name}: there is no column {signal.column!r}{hint}')
        values = columns[signal.column]
        if signal.unit == HHMMSS:
            values = values // 1e4 * 3600 + values // 100 % 100 * 60 + values % 100
        signals[name] = (signal.sign or 1) * SI[signal.unit] * values
    for name in (*NEEDED, 'vy'):
        if name not in signals and (name, 'sideslip' in signals) != ('vy', True):
            raise BagError(f'{path}: signals.{name}: is missing; the map says which column it is')
    if len(signals['vx']) < LEAST_ROWS:
        raise BagError(f'{path}: has {len(signals["vx"])} rows; at least {LEAST_ROWS}')
    if 'time' not in signals and wanted.rate_hz is None:
        raise BagError(f'{path}: the map has neither signals.time nor rate_hz')
    signals['steer'] = signals['steer'] / (wanted.steering_ratio or 1.0)
    if 'sideslip' in signals:
        signals['vy'] = signals['vx'] * np.tan(signals.pop('sideslip'))
    return signals


def _read_vbo(path):
    text = path.read_text(encoding='latin-1')
    names, data = text.partition('[column names]')[2], text.partition('[data]')[2]
    names = names.partition('[')[0].split()
    if not names or not data:
        raise BagError(f'{path}: is no VBO file: sections [column names] and [data] are missing')
    rows = [line.split() for line in data.splitlines()]
    # a file ends where the logger lost its power
    rows = [row for row in rows if len(row) == len(names)]
    try:
        return dict(zip(names, np.array(rows, float).reshape(-1, len(names)).T))
    except ValueError as error:
        raise BagError(f'{path}: {error}') from None


def _read_mat(path):
    from scipy.io import loadmat

    try:
        content = loadmat(path, squeeze_me=True)
    except (ValueError, TypeError, NotImplementedError) as error:
        raise BagError(f'{path}: is no MATLAB file up to version 7: {error}') from None
    columns = {}
    for name, value in content.items():
        if np.ndim(value) == 1 and np.issubdtype(np.asarray(value).dtype, np.number):
            columns[name] = np.asarray(value, float)
    if not columns:
        raise BagError(f'{path}: holds no vector of numbers')
    longest = max(map(len, columns.values()))
    return {name: value for name, value in columns.items() if len(value) == longest}


def _read_csv(path):
    import pandas

    try:
        frame = pandas.read_csv(path, sep=None, engine='python', skipinitialspace=True)
        frame = frame.apply(pandas.to_numeric, errors='coerce').dropna(axis=1, how='all')
    except (ValueError, UnicodeError) as error:
        raise BagError(f'{path}: is no CSV file with a header: {error}') from None
    return {str(name).strip(): column.to_numpy(float) for name, column in frame.items()}


def _read_bag(path):
    tables = bags_read.columns(path)
    for name, (topic, _) in BAG_COLUMNS.items():
        if name in (*NEEDED, 'vy') and (topic not in tables or not len(tables[topic].t_s)):
            raise BagError(f'{path}: nothing was recorded of {topic}, which has {name}')
    t = tables['/vehicle/odometry'].t_s
    signals = {'time': t}
    for name, (topic, column) in BAG_COLUMNS.items():
        if topic in tables and len(tables[topic].t_s):
            table = tables[topic]
            signals[name] = np.interp(t, table.t_s, getattr(table, column))
    return signals
