"""Columns of a log: Racelogic VBO, MATLAB 5 to 7, CSV with a header, and bags of ours.

All are read as recorded; `measured_log` looks at what the numbers are worth.
"""

from pathlib import Path

import numpy as np

from bags.errors import BagError
from experiments.measured.log_map import HHMMSS, SI, LogMap, Signals
from msgs_yaml.strict_yaml import closest

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


def read(path: Path, log_map: LogMap) -> dict[str, np.ndarray]:
    """Return the signals of `Signals` that a log has, SI, ISO 8855 axes, arrays (n,).

    Raises BagError that names the file and the signal, and OSError.
    """
    reader = {'.vbo': _read_vbo, '.mat': _read_mat, '.csv': _read_csv}.get(path.suffix.lower())
    if reader is None:
        return _read_bag(path)
    columns, wanted = reader(path), log_map.columns
    row_counts = {len(column) for column in columns.values()}
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
    if len({len(signal) for signal in signals.values()}) > 1 or min(row_counts) < LEAST_ROWS:
        raise BagError(f'{path}: columns of {min(row_counts)} to {max(row_counts)} rows')
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
    from bags.storage import read as bags_read

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
