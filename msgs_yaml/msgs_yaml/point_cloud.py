"""The points of /scenario/predictions: columns by name, packed as sensor_msgs/PointCloud2. No ROS.

One row per predicted point. Viewers show x, y, z, which therefore are numbers of 32 bits.
"""

from typing import Any

import numpy as np

U1, U4, F4, F8 = 2, 6, 7, 8  # sensor_msgs/PointField, datatype
_KINDS = {U1: 'u1', U4: 'u4', F4: 'f4', F8: 'f8'}
MOST_STEP = 2**31  # bytes of a row: numpy has no longer ones
# as they are sent, and the other types that are read
COLUMNS = {'id': (U4,), 'branch': (U1,)} | dict.fromkeys(
    ('probability', 't', 'x', 'y', 'z', 'var_x', 'cov_xy', 'var_y'), (F4, F8)
)
ROW = np.dtype([(name, f'<{_KINDS[kinds[0]]}') for name, kinds in COLUMNS.items()])


def read(message: Any) -> dict[str, np.ndarray]:
    """Return the columns (n,) of a cloud by name, its numbers as float64 or int64.

    Other fields than COLUMNS are passed over. Raises ValueError for another layout; its arguments
    are the field of the message, what it is, and what is allowed.
    """
    given = {field.name: field for field in message.fields}
    order = '>' if message.is_bigendian else '<'
    formats, offsets = [], []
    for name, kinds in COLUMNS.items():
        if name not in given:
            raise ValueError('fields', f'without {name}', ', '.join(COLUMNS))
        field = given[name]
        if field.datatype not in kinds or field.count != 1:
            what = f'{field.count} of datatype {field.datatype}'
            allowed = f'1 of datatype {" or ".join(map(str, kinds))}'
            raise ValueError(f'fields ({name})', what, allowed)
        formats.append(order + _KINDS[field.datatype])
        offsets.append(int(field.offset))
    size = int(message.point_step)
    needed = max(o + np.dtype(f).itemsize for o, f in zip(offsets, formats))
    if not needed <= size < MOST_STEP:
        allowed = f'{needed} or more, where the fields end, below {MOST_STEP}'
        raise ValueError('point_step', size, allowed)
    length = int(message.width) * int(message.height) * size
    if len(message.data) != length:
        allowed = f'{length} elements, width x height x point_step'
        raise ValueError('data', f'{len(message.data)} long', allowed)
    layout = {'names': [*COLUMNS], 'formats': formats, 'offsets': offsets, 'itemsize': size}
    rows = np.frombuffer(bytes(message.data), np.dtype(layout))
    kinds = {'u': np.int64, 'f': np.float64}
    return {name: rows[name].astype(kinds[rows[name].dtype.kind]) for name in COLUMNS}
