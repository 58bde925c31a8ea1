"""The messages of a topic as a pandas DataFrame: flat columns of numbers, indexed by time.

The index is `t_s`, the time [s] since the first odometry of the run. Topics with a line of points
have one row per point and a second level of the index: the stage of a prediction, the point of the
coarse path, edge and point of the road edges. `stamp_ns` is the ROS time [ns] of each message.

Columns end with their unit. What has members has a column per member behind a dot: a wheel
(`load_n.fl`), an obstacle by its id (`x_m.1`), a value of a report by its key (`cost.total`).
"""

import itertools
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bags.evaluation.signals import MEMBER, SIGNALS
from bags.storage.columns import TOPICS, Columns
from msgs_yaml import contract
from msgs_yaml.flat_fields import HEADING
from msgs_yaml.types import WHEELS

if TYPE_CHECKING:
    import pandas as pd

EXTRA = 'frames'
INDEX = 't_s'
REPORT = 'values'  # of a report: one column per key


class Column(NamedTuple):
    """What is in a column, or in all columns of its members."""

    unit: str
    meaning: str


COMMON = {'stamp_ns': Column('ns', 'ROS time at which the message is valid')}
PER_WHEEL = ', by wheel'
STEER = 'road-wheel angle, positive to the left'
# of topics with a table; topics.yaml has their units
TABLE_MEANINGS = {
    '/vehicle/odometry': {
        'x_m': 'X of the centre of gravity in the frame map',
        'y_m': 'Y of the centre of gravity in the frame map',
        'yaw_rad': 'yaw in the frame map, in (-pi, pi]',
        'vx_mps': 'longitudinal velocity at the centre of gravity, in base_link',
        'vy_mps': 'lateral velocity at the centre of gravity, in base_link, positive to the left',
        'yaw_rate_radps': 'yaw rate, positive to the left',
    },
    '/vehicle/actuators': {
        'steer_rad': STEER,
        'steer_rate_radps': 'its rate',
        'front_x_n': 'longitudinal force at the front axle, braking negative',
        'rear_x_n': 'longitudinal force at the rear axle, braking negative',
        'torque_nm': f'drive plus brake torque{PER_WHEEL}',
    },
    '/vehicle/imu': {
        'ax_mps2': 'longitudinal acceleration at the centre of gravity, without gravity',
        'ay_mps2': 'lateral acceleration at the centre of gravity, without gravity',
        'yaw_rate_radps': 'yaw rate, positive to the left',
        'roll_rate_radps': 'roll rate, positive to the right',
    },
    '/vehicle/wheels': {
        'spin_radps': f'angular speed{PER_WHEEL}',
        'torque_nm': f'drive plus brake torque{PER_WHEEL}',
        'load_n': f'vertical load{PER_WHEEL}',
        'slip': f'longitudinal slip{PER_WHEEL}',
        'force_x_n': f'longitudinal force in the frame of the tyre{PER_WHEEL}',
        'slip_angle_rad': f'slip angle{PER_WHEEL}',
        'force_y_n': f'lateral force in the frame of the tyre{PER_WHEEL}',
    },
    '/controller/command': {
        'steer_rad': f'set-point due one controller period after the stamp: {STEER}',
        'steer_rate_radps': 'its mean rate towards the set-point',
        'front_x_n': 'set-point likewise: longitudinal force at the front axle, braking negative',
        'rear_x_n': 'set-point likewise: longitudinal force at the rear axle, braking negative',
    },
}
# of topics whose values have no table in topics.yaml
MEANINGS = {
    '/scenario/reference': {
        'x_m': Column('m', 'X in the frame map'),
        'y_m': Column('m', 'Y in the frame map'),
        'yaw_rad': Column('rad', 'heading of the path in the frame map, continuous'),
        'passes_s': Column('s', 'when the desired vehicle passes, from the first point'),
    },
    '/scenario/road_edges': {
        'x_m': Column('m', 'X in the frame map'),
        'y_m': Column('m', 'Y in the frame map'),
    },
    '/scenario/obstacles': {
        'x_m': Column('m', 'X of the centre in the frame map, by obstacle id'),
        'y_m': Column('m', 'Y of the centre in the frame map, by obstacle id'),
        'radius_m': Column('m', 'radius, by obstacle id'),
        'vx_mps': Column('m/s', 'velocity along X in the frame map, by obstacle id'),
        'vy_mps': Column('m/s', 'velocity along Y in the frame map, by obstacle id'),
    },
    '/controller/prediction': {
        'ahead_s': Column('s', 'time of the stage after the stamp'),
        'x_m': Column('m', 'X of the centre of gravity in the frame map'),
        'y_m': Column('m', 'Y of the centre of gravity in the frame map'),
        'yaw_rad': Column('rad', 'yaw in the frame map'),
    },
    '/controller/why': {
        'level': Column('-', '0 OK, 1 WARN, 2 ERROR'),
        'message': Column('', 'one line of text'),
        REPORT: Column('', 'one column per key, as in topics.yaml'),
    },
    '/diagnostics': {
        'node': Column('', 'name of the node'),
        'level': Column('-', '0 OK, 1 WARN, 2 ERROR, 3 STALE'),
        'message': Column('', 'one line of text'),
        REPORT: Column('', 'one column per key, as the node chooses it'),
    },
    '/clock': {},
    '/vehicle/run_start': {},
}


def import_pandas() -> Any:
    """Return the module pandas; ImportError names the extra that installs it."""
    try:
        import pandas
    except ImportError as error:
        raise ImportError(
            f'a DataFrame needs pandas, which is not installed: `make setup` in a clone, or pip '
            f'with the extra bags[{EXTRA}], installs it'
        ) from error
    return pandas


def frame_of(topic: str, table: Columns) -> 'pd.DataFrame':
    """Return the table of a topic, as from `read.columns`, as a DataFrame with flat columns.

    Raises KeyError for a topic without table, ImportError without pandas.
    """
    pandas = import_pandas()
    if topic not in TOPICS:
        return _BUILDERS[topic](pandas, table)
    flat: dict[str, np.ndarray] = {}
    for name, values in vars(table).items():
        if values.ndim == 2:
            flat |= {f'{name}{MEMBER}{wheel}': v for wheel, v in zip(WHEELS, values.T)}
        elif name != INDEX:
            flat[name] = values
    return pandas.DataFrame(flat, index=_time(pandas, table.t_s))


def describe(topic: str = '') -> 'pd.DataFrame':
    """Return unit and meaning by column of a topic, by default of the derived signals.

    Raises KeyError for a topic without table, ImportError without pandas.
    """
    pandas = import_pandas()
    if not topic:
        columns = {entry.name: Column(entry.unit, entry.meaning) for entry in SIGNALS.values()}
    elif topic in TOPICS:
        units = {
            # the numbers of a heading are those of its quaternion
            field.column: 'rad' if field.value == HEADING else field.unit.replace('^2', '²')
            for field in contract.load().topics[topic].fields.values()
        }
        meanings = TABLE_MEANINGS[topic].items()
        columns = COMMON | {name: Column(units[name], meaning) for name, meaning in meanings}
    else:
        columns = COMMON | MEANINGS[topic]
    from bags.description import Description

    return Description(
        [*columns.values()], index=pandas.Index(columns, name='column'), columns=Column._fields
    )


def _time(pandas, t_s):
    return pandas.Index(t_s, name=INDEX)


def _records(pandas, table: Columns, rows: Iterable[Mapping[str, Any]]) -> 'pd.DataFrame':
    """Return a DataFrame with a row of numbers and words per message."""
    stamps = ({'stamp_ns': stamp, **row} for stamp, row in zip(table.stamp_ns.tolist(), rows))
    return pandas.DataFrame.from_records([*stamps], index=_time(pandas, table.t_s))


def _lines(pandas, table: Columns, lines: Callable[[Any], Iterable[tuple]], *levels: str):
    """Return a DataFrame with a row per point of lines.

    `lines(value)` yields of each line of a message the values of the `levels` of the index that
    all its points share, and its columns (n,); the last level is the number of the point.
    """
    columns: dict[str, list[np.ndarray]] = {}
    for stamp_ns, t_s, value in zip(table.stamp_ns, table.t_s, table.values):
        for shared, fields in lines(value):
            count = len(next(iter(fields.values())))
            same = dict(zip(('stamp_ns', INDEX, *levels[:-1]), (stamp_ns, t_s, *shared)))
            own = {name: np.full(count, constant) for name, constant in same.items()}
            # a DataFrame per line would take ten times as long
            for name, part in (own | {levels[-1]: np.arange(count)} | fields).items():
                columns.setdefault(name, []).append(part)
    joined = {name: np.concatenate(parts) for name, parts in columns.items()}
    return pandas.DataFrame(joined).set_index([INDEX, *levels])


def _poses(pandas, table, level, fields):
    """Return the frame of messages that are a line each; `fields` by column."""

    def lines(value):
        yield (), {column: getattr(value, field) for column, field in fields.items()}

    return _lines(pandas, table, lines, level)


def _edges(pandas, table):
    def lines(value):
        for side in ('left', 'right'):
            yield (side,), dict(zip(('x_m', 'y_m'), getattr(value, side).T))

    return _lines(pandas, table, lines, 'edge', 'point')


def _obstacles(pandas, table):
    names = tuple(MEANINGS['/scenario/obstacles'])
    rows = (
        {
            f'{name}{MEMBER}{item.id}': number
            for item in message.items
            for name, number in zip(names, (item.X, item.Y, item.r_obs, item.vX, item.vY))
        }
        for message in table.values
    )
    frame = _records(pandas, table, rows)
    # an obstacle that appears later is in no other place of the table
    numbers = sorted({item.id for message in table.values for item in message.items})
    return frame[['stamp_ns', *(f'{name}{MEMBER}{k}' for k in numbers for name in names)]]


def _reports(pandas, table, **about):
    """Return the frame of reports; `about` are the fields that come before their values."""
    rows = ({**{n: getattr(v, f) for n, f in about.items()}, **v.values} for v in table.values)
    return _records(pandas, table, rows)


POSE = {'x_m': 'X', 'y_m': 'Y', 'yaw_rad': 'psi'}  # columns of a pose, and its fields
STATUS = {'level': 'level', 'message': 'message'}
_BUILDERS: dict[str, Callable[[Any, Columns], 'pd.DataFrame']] = {
    '/scenario/reference': partial(_poses, level='point', fields={**POSE, 'passes_s': 't'}),
    '/scenario/road_edges': _edges,
    '/scenario/obstacles': _obstacles,
    '/controller/prediction': partial(_poses, level='stage', fields={'ahead_s': 't', **POSE}),
    '/controller/why': partial(_reports, **STATUS),
    '/diagnostics': partial(_reports, node='name', **STATUS),
    '/clock': partial(_records, rows=itertools.repeat({})),
    '/vehicle/run_start': partial(_records, rows=itertools.repeat({})),
}
FRAMED = (*TOPICS, *_BUILDERS)  # the topics that have a DataFrame
