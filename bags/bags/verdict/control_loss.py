"""Whether a car went out of control: it slid sideways at a large angle, or spun."""

import numpy as np

SLIDING_DEG = 30.0  # sideslip that no controller here plans: twice that of the tyres' limit
SPUN_DEG = 90.0  # beyond it a car moves backwards


def found(s):
    """Return {lost, lost_how, lost_at_m} of a Series.

    A car is lost when its sideslip angle exceeds SLIDING_DEG while it moves; `lost_how` is 'spun'
    when the angle exceeds SPUN_DEG later on, else 'sideslip'. The station [m] is where it began.
    """
    # not-a-number, of a car that hardly moves, exceeds nothing
    angle = np.degrees(np.abs(s.sideslip))
    beyond = np.flatnonzero(angle > SLIDING_DEG)
    if not beyond.size:
        return {'lost': False, 'lost_how': None, 'lost_at_m': None}
    how = 'spun' if np.any(angle > SPUN_DEG) else 'sideslip'
    return {'lost': True, 'lost_how': how, 'lost_at_m': float(s.station[beyond[0]])}
