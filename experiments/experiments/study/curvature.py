"""The claim on the two frames: does the overestimation of path coordinates grow with curvature?

Closed forms only (verdict.two_frames), so there is no interval: it holds at a place or it does not.
"""

from typing import Any

import numpy as np

from bags.evaluation import frame_distances

RADII_M = (200.0, 100.0, 50.0, 20.0)  # growing curvature
GAPS_M = tuple(range(1, 41))  # along the path, up to the preview of 2 s
BESIDE_M = 1.0  # obstacle from the path
REACH_M = 2.1  # both radii


def shares() -> dict[str, dict[str, Any]]:
    """Return, inside and outside of the curve, where the claim holds and what it amounts to.

    `grows` counts the (gap, pair of neighbouring radii) at which the sharper curve overestimates
    more; `at_20m` is the overestimation [m] 20 m before the obstacle, by radius.
    """
    found = {}
    for side, inside in (('inside', BESIDE_M), ('outside', -BESIDE_M)):
        gaps, radii = np.array(GAPS_M, dtype=float), np.array(RADII_M)[:, None]
        more = frame_distances.circle_distances(radii, gaps, inside, REACH_M).overestimation
        steps = np.diff(more, axis=0) > 0
        at = GAPS_M.index(20)
        found[side] = {
            'grows': int(np.count_nonzero(steps)),
            'of': int(steps.size),
            'at_20m': {f'{radius:g}': float(row[at]) for radius, row in zip(RADII_M, more)},
        }
    return found


def row() -> dict[str, Any]:
    """Return the claim as a row of claims.json."""
    found = shares()
    inside, outside = found['inside'], found['outside']
    everywhere = all(side['grows'] == side['of'] for side in found.values())
    anywhere = inside['grows'] == inside['of']
    return {
        'key': 'overestimation',
        'claim': 'path coordinates overestimate V2O, the more the greater the curvature',
        'paper': 'grows with curvature',
        'ours': (
            f'inside the curve at {inside["grows"]} of {inside["of"]} places, outside at '
            f'{outside["grows"]} of {outside["of"]}; 20 m ahead on a radius of 20 m '
            f'{inside["at_20m"]["20"]:+.2f} m and {outside["at_20m"]["20"]:+.2f} m'
        ),
        'verdict': 'reproduced' if everywhere else 'partly' if anywhere else 'not',
        'interval': 'exact, closed form',
        'cause': 'geometry: chord against arc; outside near the obstacle the sign turns',
        'data': found,
    }
