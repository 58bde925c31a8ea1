"""Speeds at which a controller stops instead of driving: below or near its minimum speed.

Measured on `straight` with `limits.least_speed_mps` of 7 m/s: a start at 7 m/s stops, one at
7.05 m/s drives; a car that slows down from 15 m/s to a desired speed undershoots it, so it stops
with a desired speed of 7.4 m/s and drives with 7.6 m/s.
"""

START_MARGIN_MPS = 0.2  # above the minimum speed a start may still stop
DESIRED_MARGIN_MPS = 0.5  # the same for a desired speed
ROUNDING_MPS = 0.01  # of a desired speed, which is a distance over a time

BELOW, NEAR = 'below', 'at or just above'


def compare(speed_mps: float, minimum_mps: float, margin_mps: float) -> str:
    """Return BELOW, NEAR (within the margin above), or '' for a speed that is high enough."""
    if speed_mps < minimum_mps - ROUNDING_MPS:
        return BELOW
    return NEAR if speed_mps <= minimum_mps + margin_mps + ROUNDING_MPS else ''
