"""What an estimator says, and its message."""

from typing import NamedTuple

import numpy as np

from msgs_yaml.types import EstimatedState, VehicleState

OK, DIVERGED = 'ok', 'diverged'


class Estimate(NamedTuple):
    """The state after a message of the IMU."""

    state: VehicleState
    covariance: np.ndarray  # (6, 6) of X, Y, psi, vx, vy, r; 0 of an estimator that states none
    friction: float  # -, of the road
    status: str  # OK, DIVERGED, or what is missing

    def as_message(self) -> EstimatedState:
        """Return the value of /estimator/odometry.

        The message has no room for the covariances of pose and twist.
        """
        rows = self.covariance.tolist()
        blocks = [rows[i][j] for k in (0, 3) for i in range(k, k + 3) for j in range(i, k + 3)]
        return EstimatedState(*self.state, *blocks)
