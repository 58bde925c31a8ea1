"""The messages of a topic as a pandas DataFrame: flat columns of numbers, indexed by time.

The index is `t_s`, the time [s] since the first odometry of the run. Topics with a line of points
have one row per point and a second level of the index: the stage of a prediction, the point of the
coarse path, edge and point of the road edges. `stamp_ns` is the ROS time [ns] of each message.

Columns end with their unit. What has members has a column per member behind a dot: a wheel
(`load_n.fl`), an obstacle by its id (`x_m.1`) and behind that its further discs (`x_m.1.1`), a
value of a report by its key (`cost.total`).
"""

from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from bags.evaluation.signals import MEMBER, SIGNALS
from bags.storage.columns import DECODERS, TOPICS, Columns
from msgs_yaml import contract
from msgs_yaml.flat_fields import HEADING
from msgs_yaml.types import WHEELS, Branch

if TYPE_CHECKING:
    import pandas as pd

EXTRA = 'frames'
INDEX = 't_s'
OBSTACLES, PREDICTIONS = '/scenario/obstacles', '/scenario/predictions'
REPORT = 'values'  # of a report: one column per key
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
# the topics that have a DataFrame
FRAMED = (*TOPICS, *(name for name in DECODERS if name not in TOPICS))


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
    if topic not in TOPICS:
        stamped = zip(table.stamp_ns.tolist(), table.values)
        rows = [{'stamp_ns': stamp_ns, **_row(topic, value)} for stamp_ns, value in stamped]
        frame = pandas.DataFrame.from_records(rows, index=index)
        if topic == OBSTACLES:
            # by id: one that appears later is in no other place of the table
            stamp, *members = frame
            members.sort(key=lambda name: [*map(int, name.split(MEMBER)[1:])])
            frame = frame[[stamp, *members]]
        return frame
    flat: dict[str, np.ndarray] = {}
    for name, values in table.items():
        if values.ndim == 2:
            flat |= {f'{name}{MEMBER}{wheel}': v for wheel, v in zip(WHEELS, values.T)}
        elif name != INDEX:
            flat[name] = values
    return pandas.DataFrame(flat, index=index)


def _columns(topic):
    """Return what topics.yaml says of each column of a topic."""
    return contract.load().topics[topic].columns


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
            yield levels | dict(zip(_columns(topic), numbers))
        return
    (level,) = LEVELS[topic]
    line = {level: np.arange(len(value.t))}
    yield line | {name: getattr(value, FIELDS[name]) for name in _columns(topic)}


def _row(topic, value):
    """Return what a message has besides its stamp, by column."""
    if topic == OBSTACLES:
        names, row = _columns(topic), {}
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
        rows = {}
        for name, entry in SIGNALS.items():
            keys, such_as = entry.keys
            each = f' A column per {keys}, as {name}{MEMBER}{such_as}.' if keys else ''
            rows[name] = entry.unit, entry.meaning + each
    else:
        units = {
            # the numbers of a heading are those of its quaternion
            field.column: 'rad' if field.value == HEADING else field.unit.replace('^2', '²')
            for field in contract.load().topics[topic].fields.values()
        }
        rows = {'stamp_ns': ('ns', 'ROS time at which the message is valid')}
        for name, column in _columns(topic).items():
            rows[name] = column.unit or units.get(name, ''), column.meaning
    index = pandas.Index(rows, name='column')
    return _description()([*rows.values()], index=index, columns=['unit', 'meaning'])


@cache
def _description():
    """Return a DataFrame that shows every sentence whole; pandas cuts it after 50 characters."""
    import pandas

    class Description(pandas.DataFrame):
        @property
        def _constructor(self):
            return Description

        def __repr__(self):
            width = max(map(len, map(str, self.get('meaning', ()))), default=0)
            return self.to_string(formatters={'meaning': f'{{:<{width}}}'.format})

        def _repr_html_(self):
            with pandas.option_context('display.max_colwidth', None):
                return self.to_html()

    return Description
