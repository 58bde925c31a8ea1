"""Columns out of the raw messages of one topic, thousands at a time."""

import numpy as np

from bags.errors import BagError
from bags.storage import layout
from bags.storage.columns import Columns, Source
from bags.storage.rosbag2_layout import BagTopic
from msgs_yaml import yaw
from msgs_yaml.stamp import NS_PER_S

YAW = 'yaw_rad'


def build(source: Source, topic: BagTopic, payloads: list[bytes], zero_ns: int) -> Columns:
    """Return the table of `payloads` (CDR), n >= 1; `zero_ns` is the stamp at which t_s is 0.

    Raises BagError when a message does not fit its definition or lacks a name.
    """
    n = len(payloads)
    stamp_ns = np.empty(n, dtype=np.int64)
    found = {
        name: np.empty((n, len(paths)) if isinstance(paths, tuple) else n)
        for name, paths in source.paths.items()
    }
    for rows, bytes_, where in layout.groups(payloads, topic.schema, topic.type):
        stamp_ns[rows] = _stamp_ns(source.stamp, bytes_, where)
        for name, paths in source.paths.items():
            if isinstance(paths, tuple):
                columns = [column(bytes_, where, path) for path in paths]
                found[name][rows] = np.stack(columns, axis=1)
            else:
                found[name][rows] = column(bytes_, where, paths)
    if YAW in found:
        # math.atan2, as every receiver of the message uses: numpy's may differ in the last bit
        found[YAW] = np.array([yaw.from_quaternion(z, w) for z, w in found[YAW].tolist()])
    return source.table(stamp_ns=stamp_ns, t_s=(stamp_ns - zero_ns) / NS_PER_S, **found)


def _stamp_ns(path, bytes_, where):
    sec, nanosec = (column(bytes_, where, f'{path}.{part}') for part in ('sec', 'nanosec'))
    if not (np.can_cast(sec.dtype, np.int32) and np.can_cast(nanosec.dtype, np.uint32)):
        raise BagError(f'{path} is of {sec.dtype} and {nanosec.dtype}; allowed int32 and uint32')
    return sec.astype(np.int64) * NS_PER_S + nanosec


def column(bytes_: np.ndarray, where: layout.Layout, path: str) -> np.ndarray:
    """A column by its path; 'effort[steer]' goes by the place of 'steer' in `name`."""
    array, bracket, joint = path.partition('[')
    if bracket:
        joints = [where.strings[f'name[{i}]'] for i in range(_count(where.strings))]
        wanted = joint.rstrip(']')
        if wanted not in joints:
            raise BagError(f'no joint {wanted!r}; it has {", ".join(joints)}')
        path = f'{array}[{joints.index(wanted)}]'
    if path not in where.numbers:
        raise BagError(f'no {path} in the message')
    return layout.column(bytes_, where, path)


def _count(strings):
    return sum(path.startswith('name[') for path in strings)
