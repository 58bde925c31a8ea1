"""The columns of a run that was made in process: the same tables as those read from its bag."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from bags.storage import columns
from msgs_yaml import ring
from msgs_yaml.stamp import NS_PER_S

SLOW_NS = 10_000_000  # /vehicle/imu and /vehicle/wheels


def of(
    track: Any,
    commands: Sequence[Any],
    values: dict[str, Sequence[Any]],
) -> dict[str, columns.Columns]:
    """Return the tables by topic.

    track     the plant's, one row per millisecond, first row the start
    commands  one per tick
    values    values of `msgs_yaml.types` for every other topic, each with its stamp
    """
    zero_ns = int(track.stamp_ns[0])
    slow = track.where(track.stamp_ns % SLOW_NS == 0)
    tables = {
        '/vehicle/odometry': (columns.Odometry, [ring.odometry(x) for x in track.states()]),
        '/vehicle/actuators': (columns.Actuators, track.actuators()),
        '/vehicle/imu': (columns.Imu, slow.imu()),
        '/vehicle/wheels': (columns.Wheels, slow.wheels()),
        '/controller/command': (columns.Command, commands),
    }
    made = {topic: _table(form, rows, zero_ns) for topic, (form, rows) in tables.items()}
    return made | {topic: _values(rows, zero_ns) for topic, rows in values.items()}


def _table(form, rows, zero_ns):
    """The fields of the values and the columns after the time stand in the same order."""
    stamps, *fields = zip(*rows)
    stamp_ns = np.array(stamps, dtype=np.int64)
    return form(stamp_ns, _seconds(stamp_ns, zero_ns), *(np.array(f, float) for f in fields))


def _values(rows, zero_ns):
    stamp_ns = np.array([one.stamp_ns for one in rows], dtype=np.int64)
    return columns.Values(stamp_ns, _seconds(stamp_ns, zero_ns), tuple(rows))


def _seconds(stamp_ns, zero_ns):
    return (stamp_ns - zero_ns) / NS_PER_S
