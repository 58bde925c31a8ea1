"""At which speeds a controller that is to drive stops instead: those below or near its least speed.

Measured on `straight` with a least speed of 7 m/s: a start at 7 m/s stops and one at 7.05 m/s
drives; a car that slows down from 15 m/s to a desired speed falls below that speed for a moment, so
it stops with 7.4 m/s and drives with 7.6 m/s.
"""

START_MARGIN_MPS = 0.2  # above the least speed a start may still stop
DESIRED_MARGIN_MPS = 0.5  # and so may a car that is to drive at this speed
ROUNDING_MPS = 0.01  # of a desired speed, which comes as distance and time

BELOW, NEAR = 'below', 'at or just above'


def relation(speed_mps: float, least_mps: float, margin_mps: float) -> str:
    """Return how a speed lies to the least speed: BELOW, NEAR (within the margin), or ''."""
    if speed_mps < least_mps - ROUNDING_MPS:
        return BELOW
    return NEAR if speed_mps <= least_mps + margin_mps + ROUNDING_MPS else ''
