"""Which samples of a car have a stamp of another time than the messages around them.

Any stamp after 1970 obeys the contract, also that of a player or of a ring in simulated time which
publishes on the topics of a ring on the wall clock.
"""

from bisect import bisect_right
from collections.abc import Iterator

import numpy as np

from msgs_yaml.stamp import NS_PER_S

TOPICS = ('/vehicle/odometry', '/vehicle/actuators', '/vehicle/imu', '/vehicle/wheels')
# How much later or earlier than usual a sample may be recorded: a plant that was stopped for
# minutes sends what it missed, and no other clock is as near by chance.
NEAR_NS = 600 * NS_PER_S


def foreign(
    stamp_ns: np.ndarray, log_ns: np.ndarray, keep_twins: bool = False
) -> Iterator[tuple[int, str]]:
    """Yield (row, what is wrong) of the samples of a topic with a stamp of another time.

    From stamp to log time it takes all samples of a topic about as long, in lockstep no time. Of
    those that are near, as few are foreign as can be while no stamp of the others falls back; with
    `keep_twins` only those whose stamp none of the others has.
    """
    took_ns = log_ns - stamp_ns
    off_ns = took_ns - np.median(took_ns)
    near = np.flatnonzero(np.abs(off_ns) <= NEAR_NS)
    for row in np.setdiff1d(np.arange(len(stamp_ns)), near).tolist():
        yield (
            row,
            f'header.stamp is {stamp_ns[row] / NS_PER_S:.3f} s, '
            f'{abs(off_ns[row]) / NS_PER_S:.0f} s from the stamps that were recorded about then; '
            f'allowed up to {NEAR_NS / NS_PER_S:.0f} s',
        )
    if np.all(np.diff(stamp_ns[near]) >= 0):
        return
    kept = near[_in_order(stamp_ns[near].tolist())]
    if keep_twins:
        kept = near[np.isin(stamp_ns[near], stamp_ns[kept])]
    for row in np.setdiff1d(near, kept).tolist():
        yield row, f'header.stamp is {stamp_ns[row] / NS_PER_S:.3f} s; the stamps fall back'


def _in_order(stamps):
    """Return the places of a longest selection of stamps that never falls back."""
    # the least stamp that ends a selection of each length, its place, and the place before each
    ends, places, before = [], [], []
    for place, stamp in enumerate(stamps):
        length = bisect_right(ends, stamp)
        before.append(places[length - 1] if length else None)
        ends[length : length + 1], places[length : length + 1] = [stamp], [place]
    chosen = [places[-1]]
    while before[chosen[-1]] is not None:
        chosen.append(before[chosen[-1]])
    return chosen[::-1]
