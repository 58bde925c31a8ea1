"""Paths and road edges of any length, as messages and as bytes, and the time to read them."""

import time
from timeit import repeat

import numpy as np

from msgs_yaml.types import Reference, RoadEdges

S = 1_000_000_000
LATER_NS = 1_795_000_000_987_654_321
LONGEST = 40_000  # poses, points: the most that the contract allows
SPACING_M = 0.5


def path(poses=LONGEST, stamp_ns=5 * S + 3):
    """Return a winding path with `poses` poses, half a metre apart."""
    s = SPACING_M * np.arange(poses)
    psi = 4.0 * np.sin(0.01 * s)  # beyond pi
    X, Y = SPACING_M * np.cumsum(np.cos(psi)), SPACING_M * np.cumsum(np.sin(psi))
    return Reference(stamp_ns, X, Y, psi, np.cumsum(SPACING_M / (15.0 + np.sin(s))))


def edges(points=LONGEST, stamp_ns=5 * S + 3):
    """Return the edges beside `path`."""
    middle = path(points)
    left, right = (np.column_stack([middle.X, middle.Y + offset]) for offset in (3.5, -3.5))
    return RoadEdges(stamp_ns, left, right)


def are_equal(ours, theirs):
    """Return whether two values of `types` are equal, arrays bit for bit and in type."""
    return type(ours) is type(theirs) and all(
        np.asarray(a).dtype == np.asarray(b).dtype
        and np.shape(a) == np.shape(b)
        and np.asarray(a).tobytes() == np.asarray(b).tobytes()
        for a, b in zip(ours, theirs)
    )


def min_cpu_s(call, times=5):
    """Return the minimum processor time of a call [s]; other processes do not change it."""
    return min(repeat(call, number=1, repeat=times, timer=time.process_time))
