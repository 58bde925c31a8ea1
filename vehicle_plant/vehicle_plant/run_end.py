"""End of a run: finish line, time limit, standstill. Each has its exit code."""

import math
from typing import NamedTuple

import numpy as np

from vehicle_plant.gate import NS_PER_S
from vehicle_plant.parameters import StopParams
from vehicle_plant.state import Trajectory

FINISHED = 0
FAILED = 2
CONTROLLER_GONE = 3
EXIT_CODES = {
    FINISHED: 'the car crossed the finish line',
    FAILED: 'the time limit passed, or the car stood still',
    CONTROLLER_GONE: 'no command came any more; the car was braked',
}
_STANDSTILL_MPS = 0.1
_STANDSTILL_S = 1.0


class Outcome(NamedTuple):
    """How a run ended."""

    exit_code: int
    message: str
    stamp_ns: int


class RunEnd:
    """Checks the trajectory of one run, piece by piece."""

    def __init__(self, stop: StopParams, start: Trajectory):
        """Begin at a trajectory of one row."""
        self._stop = stop
        self._last = start
        self._start_ns = self._still_since_ns = int(start.stamp_ns[-1])
        self._travelled_m = 0.0
        self._moved = False

    @property
    def standing(self) -> bool:
        """Whether the car has stood still for a second."""
        return self._standing_s() >= _STANDSTILL_S

    def check(self, piece: Trajectory) -> Outcome | None:
        """Return how the run ended within these rows, or None. Call once per piece, in order."""
        crossing_ns = self._find_crossing(piece)
        speed = np.hypot(piece.column('planar.vx'), piece.column('planar.vy'))
        moving_ns = piece.stamp_ns[~(speed < _STANDSTILL_MPS)]  # NaN does not stand
        if len(moving_ns):
            self._moved, self._still_since_ns = True, int(moving_ns[-1])
        self._last = Trajectory(piece.stamp_ns[-1:], piece.rows[-1:])
        now_ns = int(piece.stamp_ns[-1])
        if crossing_ns is not None:
            seconds = (crossing_ns - self._start_ns) / NS_PER_S
            return Outcome(FINISHED, f'finish line crossed after {seconds:.3f} s', crossing_ns)
        if (now_ns - self._start_ns) / NS_PER_S >= self._stop.time_s:
            message = f'finish line not reached within {self._stop.time_s:g} s'
            return Outcome(FAILED, message, now_ns)
        if self._moved and self._standing_s() >= (self._stop.standstill_s or _STANDSTILL_S):
            return Outcome(FAILED, 'the car stands still', now_ns)
        return None

    def _standing_s(self) -> float:
        return (int(self._last.stamp_ns[-1]) - self._still_since_ns) / NS_PER_S

    def _find_crossing(self, piece: Trajectory) -> int | None:
        """Return the stamp of the first row behind the line after a row before it."""
        X = np.concatenate([self._last.column('planar.X'), piece.column('planar.X')])
        Y = np.concatenate([self._last.column('planar.Y'), piece.column('planar.Y')])
        travelled_m = self._travelled_m + np.cumsum(np.hypot(np.diff(X), np.diff(Y)))
        self._travelled_m = float(travelled_m[-1])
        stop = self._stop
        ahead = (X - stop.x_m) * math.cos(stop.yaw_rad) + (Y - stop.y_m) * math.sin(stop.yaw_rad)
        crossed = (ahead[:-1] < 0) & (ahead[1:] >= 0) & (travelled_m >= stop.armed_after_m)
        return int(piece.stamp_ns[np.argmax(crossed)]) if crossed.any() else None
