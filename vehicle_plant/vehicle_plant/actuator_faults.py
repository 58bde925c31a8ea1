"""Faults of the actuators: what the servos are given instead of the set-points. SI units."""

import math

import numpy as np

from msgs_yaml.conversions import NS_PER_S
from vehicle_plant.actuators import DelayLine
from vehicle_plant.car import FaultParams
from vehicle_plant.state import SetPoints


class ActuatorFaults:
    """Changes the set-points of the servos while there are faults."""

    def __init__(self, params: FaultParams, held: SetPoints, start_ns: int):
        """`held` are the set-points until `start_ns` [ns], from which times count."""
        until_s = math.inf if params.until_s is None else params.until_s
        self._while_s, self._start_ns = (params.from_s or 0.0, until_s), start_ns
        shares = (params.front_force_share, params.rear_force_share)
        self._factors = np.array([1.0, *(1.0 if share is None else share for share in shares)])
        self._offsets = np.array([params.steer_offset_rad or 0.0, 0.0, 0.0])
        self._line = DelayLine(SetPoints(*(params.delay_ms or 0,) * len(held)), held)
        self._sticks, self._stuck_at = bool(params.steer_stuck), None

    def apply(self, set_points: np.ndarray, stamps_ns: np.ndarray) -> np.ndarray:
        """Return what the servos follow, (n + 1, 3), of the set-points at n + 1 stamps.

        The first row is the last one of the call before.
        """
        late = self._line.shift(set_points)
        t = (stamps_ns - self._start_ns) / NS_PER_S
        is_faulty = (self._while_s[0] <= t) & (t < self._while_s[1])
        if not is_faulty.any():
            return set_points
        changed = self._factors * late + self._offsets
        if self._sticks:
            if self._stuck_at is None:
                self._stuck_at = set_points[np.argmax(is_faulty), 0]
            changed[:, 0] = self._stuck_at
        return np.where(is_faulty[:, None], changed, set_points)
