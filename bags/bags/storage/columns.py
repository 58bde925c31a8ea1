"""The numbers of a run as columns: one row per message, names with units, SI, ISO 8855 axes.

Every table begins with `stamp_ns` (int64, ROS time) and `t_s` (float64, seconds since the zero of
the run: its first odometry). Columns have shape (n,), those of the wheels (n, 4) in the order
front-left, front-right, rear-left, rear-right. Positions and yaw, in (-pi, pi], are in the frame
map, velocities and accelerations in base_link at the centre of gravity, tyre forces in the tyre
frame. The tables Odometry, Actuators, Imu, Wheels and Command have the columns of topics.yaml
(`msgs_yaml.flat_fields`), such as `columns.Imu._fields`.
"""

from collections import namedtuple
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from msgs_yaml import flat_fields

TOPICS = tuple(flat_fields.TYPES)  # those with a table
Columns = tuple  # a table of TOPICS, or Values


def _repr(table) -> str:
    return f'{type(table).__name__}({len(table.stamp_ns)} rows: {", ".join(table._fields)})'


class Values(NamedTuple):
    """Any other topic: the values of `msgs_yaml.types`, one per message."""

    stamp_ns: np.ndarray
    t_s: np.ndarray
    values: tuple[Any, ...]

    __repr__ = _repr


@cache
def table_type(topic: str) -> type:
    """Return the type of the table of one of TOPICS; KeyError for another topic."""
    name, columns = _class_name(topic), ('stamp_ns', 't_s', *flat_fields.load(topic).columns)
    members = {'__doc__': f'{topic}: {", ".join(columns)}.', '__slots__': (), '__repr__': _repr}
    return type(name, (namedtuple(name, columns),), members | {'__module__': __name__})


def __getattr__(name: str) -> type:
    """Return a table type by its name above, which needs the contract: not read at import."""
    for topic in TOPICS:
        if name == _class_name(topic):
            return table_type(topic)
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def _class_name(topic):
    return topic.rsplit('/', 1)[1].capitalize()
