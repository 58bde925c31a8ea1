"""The messages of a topic as a pandas DataFrame: flat columns of numbers, indexed by time.

The index is `t_s`, the time [s] since the first odometry of the run. Topics with a line of points
have one row per point and a second level of the index: the stage of a prediction, the point of the
coarse path, edge and point of the road edges. `stamp_ns` is the ROS time [ns] of each message.

Columns end with their unit. What has members has a column per member behind a dot: a wheel
(`load_n.fl`), an obstacle by its id (`x_m.1`) and behind that its further discs (`x_m.1.1`), a
value of a report by its key (`cost.total`).
"""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bags.evaluation.signals import MEMBER, SIGNALS
from bags.storage.columns import TOPICS, Columns
from msgs_yaml import contract
from msgs_yaml.flat_fields import HEADING
from msgs_yaml.types import WHEELS, Branch

if TYPE_CHECKING:
    import pandas as pd

EXTRA = 'frames'
INDEX = 't_s'
OBSTACLES, PREDICTIONS = '/scenario/obstacles', '/scenario/predictions'
REPORT = 'values'  # of a report: one column per key


class Column(NamedTuple):
    """What is in a column, or in all columns of its members."""

    unit: str
    meaning: str


COMMON = {'stamp_ns': Column('ns', 'ROS time at which the message is valid')}
PER_WHEEL = ', by wheel'
STEER = 'road-wheel angle, positive to the left'
STATE = {
    'x_m': 'X of the centre of gravity in the frame map',
    'y_m': 'Y of the centre of gravity in the frame map',
    'yaw_rad': 'yaw in the frame map, in (-pi, pi]',
    'vx_mps': 'longitudinal velocity at the centre of gravity, in base_link',
    'vy_mps': 'lateral velocity at the centre of gravity, in base_link, positive to the left',
    'yaw_rate_radps': 'yaw rate, positive to the left',
}
# of topics with a table; topics.yaml has their units
TABLE_MEANINGS = {
    '/vehicle/odometry': STATE,
    '/estimator/odometry': {
        **{name: f'estimated {meaning}' for name, meaning in STATE.items()},
        'var_x_m2': 'variance of x_m',
        'cov_xy_m2': 'covariance of x_m and y_m',
        'cov_x_yaw_mrad': 'covariance of x_m and yaw_rad',
        'var_y_m2': 'variance of y_m',
        'cov_y_yaw_mrad': 'covariance of y_m and yaw_rad',
        'var_yaw_rad2': 'variance of yaw_rad',
        'var_vx_m2ps2': 'variance of vx_mps',
        'cov_vx_vy_m2ps2': 'covariance of vx_mps and vy_mps',
        'cov_vx_yaw_rate_mradps2': 'covariance of vx_mps and yaw_rate_radps',
        'var_vy_m2ps2': 'variance of vy_mps',
        'cov_vy_yaw_rate_mradps2': 'covariance of vy_mps and yaw_rate_radps',
        'var_yaw_rate_rad2ps2': 'variance of yaw_rate_radps',
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
    '/sensors/inertial': {
        'ax_mps2': 'measured longitudinal acceleration in the body, with the share of gravity',
        'ay_mps2': 'measured lateral acceleration in the body, with the share of gravity',
        'yaw_rate_radps': 'measured yaw rate, positive to the left',
        'roll_rate_radps': 'measured roll rate, positive to the right',
    },
    '/sensors/chassis': {
        'steer_rad': f'measured {STEER}',
        'spin_radps': f'measured angular speed{PER_WHEEL}',
    },
    '/sensors/gnss': {
        'x_m': 'measured X of the centre of gravity in the frame map',
        'y_m': 'measured Y of the centre of gravity in the frame map',
        'velocity_x_mps': 'measured velocity along X in the frame map',
        'velocity_y_mps': 'measured velocity along Y in the frame map',
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
    OBSTACLES: {
        'x_m': Column('m', 'X of the centre of each disc in the frame map, by obstacle id'),
        'y_m': Column('m', 'Y of the centre of each disc in the frame map, by obstacle id'),
        'radius_m': Column('m', 'radius of its discs, by obstacle id'),
        'vx_mps': Column('m/s', 'velocity along X in the frame map, by obstacle id'),
        'vy_mps': Column('m/s', 'velocity along Y in the frame map, by obstacle id'),
    },
    PREDICTIONS: {
        'probability': Column('-', 'of the branch'),
        'ahead_s': Column('s', 'time of the point after the stamp'),
        'x_m': Column('m', 'X of the first disc of the obstacle in the frame map'),
        'y_m': Column('m', 'Y of the first disc of the obstacle in the frame map'),
        'var_x_m2': Column('m²', 'variance of X'),
        'cov_xy_m2': Column('m²', 'covariance of X and Y'),
        'var_y_m2': Column('m²', 'variance of Y'),
    },
    '/controller/prediction': {
        'ahead_s': Column('s', 'time of the stage after the stamp'),
        'x_m': Column('m', 'X of the centre of gravity in the frame map'),
        'y_m': Column('m', 'Y of the centre of gravity in the frame map'),
        'yaw_rad': Column('rad', 'yaw in the frame map'),
    },
    '/controller/stop_plan': {
        'ahead_s': Column('s', 'time after the stamp at which the set-points are due'),
        'steer_rad': Column('rad', STEER),
        'front_x_n': Column('N', 'longitudinal force at the front axle, braking negative'),
        'rear_x_n': Column('N', 'longitudinal force at the rear axle, braking negative'),
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


# of topics with lines of points: the levels of the index behind the time
LEVELS = {
    '/scenario/reference': ('point',),
    '/scenario/road_edges': ('edge', 'point'),
    PREDICTIONS: ('id', 'branch', 'point'),
    '/controller/prediction': ('stage',),
    '/controller/stop_plan': ('point',),
}
# fields of poses and set-points by column
FIELDS = {'x_m': 'X', 'y_m': 'Y', 'yaw_rad': 'psi', 'passes_s': 't', 'ahead_s': 't'}
FIELDS |= {'steer_rad': 'delta', 'front_x_n': 'Fxf', 'rear_x_n': 'Fxr'}
FRAMED = (*TOPICS, *MEANINGS)  # the topics that have a DataFrame


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
    if topic in LEVELS:
        lines = [
            {'stamp_ns': stamp_ns, INDEX: t_s, **line}
            for stamp_ns, t_s, value in zip(table.stamp_ns, table.t_s, table.values)
            for line in _lines(topic, value)
        ]
        # a DataFrame per line would take ten times as long
        last = LEVELS[topic][-1]  # has a value per point
        points = {
            name: np.concatenate([np.broadcast_to(line[name], len(line[last])) for line in lines])
            for name in lines[0]
        }
        return pandas.DataFrame(points).set_index([INDEX, *LEVELS[topic]])
    index = pandas.Index(table.t_s, name=INDEX)
    if topic in MEANINGS:
        stamped = zip(table.stamp_ns.tolist(), table.values)
        rows = [{'stamp_ns': stamp_ns, **_row(topic, value)} for stamp_ns, value in stamped]
        frame = pandas.DataFrame.from_records(rows, index=index)
        if topic == OBSTACLES:
            # by id: one that appears later is in no other place of the table
            stamp, *members = frame
            members.sort(key=lambda name: [*map(int, name.split(MEMBER)[1:])])
            frame = frame[[stamp, *members]]
        return frame
    if topic not in TOPICS:
        raise KeyError(topic)
    flat: dict[str, np.ndarray] = {}
    for name, values in table.items():
        if values.ndim == 2:
            flat |= {f'{name}{MEMBER}{wheel}': v for wheel, v in zip(WHEELS, values.T)}
        elif name != INDEX:
            flat[name] = values
    return pandas.DataFrame(flat, index=index)


def _lines(topic, value):
    """Yield of each line of a message its columns (n,) and the levels of its points."""
    if topic == '/scenario/road_edges':
        for side in ('left', 'right'):
            x, y = getattr(value, side).T
            yield {'edge': side, 'point': np.arange(len(x)), 'x_m': x, 'y_m': y}
        return
    if topic == PREDICTIONS:
        branches = [(k, i, b) for k, several in value.by_id.items() for i, b in enumerate(several)]
        none = np.empty(0)
        nothing = Branch(0, 0.0, none, none, none, np.empty((0, 2, 2)))
        for number, i, b in branches or [(0, 0, nothing)]:
            levels = {'id': number, 'branch': i, 'point': np.arange(len(b.t))}
            (var_x, cov_xy), (_, var_y) = b.covariance.transpose(1, 2, 0)
            numbers = (b.probability, b.t, b.X, b.Y, var_x, cov_xy, var_y)
            yield levels | dict(zip(MEANINGS[topic], numbers))
        return
    (level,) = LEVELS[topic]
    line = {level: np.arange(len(value.t))}
    yield line | {name: getattr(value, FIELDS[name]) for name in MEANINGS[topic]}


def _row(topic, value):
    """Return what a message has besides its stamp, by column."""
    if topic == OBSTACLES:
        names, row = MEANINGS[topic], {}
        for item in value.items:
            numbers = item.X, item.Y, item.r_obs, item.vX, item.vY
            row |= {f'{name}{MEMBER}{item.id}': number for name, number in zip(names, numbers)}
            for k, place in enumerate(item.others, 1):
                at = item.X + place[0], item.Y + place[1]
                row |= {f'{name}{MEMBER}{item.id}{MEMBER}{k}': x for name, x in zip(names, at)}
        return row
    if topic not in ('/controller/why', '/diagnostics'):
        return {}
    node = {'node': value.name} if topic == '/diagnostics' else {}
    return {**node, 'level': value.level, 'message': value.message, **value.values}


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
