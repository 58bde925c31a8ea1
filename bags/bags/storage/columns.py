"""The numbers of a run as columns: one row per message, names with units, SI, ISO 8855 axes.

Every table begins with `stamp_ns` (int64, ROS time) and `t_s` (float64, seconds since the zero of
the run: its first odometry). Columns have shape (n,), those of the wheels (n, 4) in the order
front-left, front-right, rear-left, rear-right. Positions and yaw, in (-pi, pi], are in the frame
map, velocities and accelerations in base_link at the centre of gravity, tyre forces in the tyre
frame. The tables of TOPICS have the columns of topics.yaml (`msgs_yaml.flat_fields`); that of any
other topic has one more column, `values`: a tuple of values of `msgs_yaml.types`.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from msgs_yaml import flat_fields

TOPICS = tuple(flat_fields.TYPES)  # those whose columns are numbers


class Columns:
    """The table of a topic; its columns are attributes, in the order of `names`."""

    stamp_ns: np.ndarray
    t_s: np.ndarray

    def __init__(self, stamp_ns: np.ndarray, t_s: np.ndarray, **others: Any):
        vars(self).update(stamp_ns=stamp_ns, t_s=t_s, **others)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f'no column {name}; there are {", ".join(vars(self))}')

    def __iter__(self) -> Iterator[Any]:
        return iter(vars(self).values())

    def items(self) -> Iterator[tuple[str, Any]]:
        """Return the columns with their names."""
        return iter(vars(self).items())

    def __repr__(self) -> str:
        return f'Columns({len(self.stamp_ns)} rows: {", ".join(vars(self))})'


def names(topic: str) -> tuple[str, ...]:
    """Return the columns of one of TOPICS; KeyError for another topic."""
    return ('stamp_ns', 't_s', *flat_fields.load(topic).columns)
