"""What an estimator says."""

from typing import NamedTuple

import numpy as np

from msgs_yaml.types import VehicleState

OK, DIVERGED = 'ok', 'diverged'


class Estimate(NamedTuple):
    """The state after a message of the IMU."""

    state: VehicleState
    covariance: np.ndarray  # (6, 6) of X, Y, psi, vx, vy, r
    friction: float  # -, of the road
    status: str  # OK, DIVERGED, or what is missing
