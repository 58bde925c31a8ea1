"""When a run is over: finish line, time-out, standstill. Each has its exit code."""

import math
from typing import NamedTuple

import numpy as np

from vehicle_plant.gate import NS_PER_S
from vehicle_plant.parameters import StopParams
from vehicle_plant.state import Trajectory

FINISHED = 0
FAILED = 2
CONTROLLER_GONE = 3
_STANDSTILL_MPS = 0.1
_STANDSTILL_S = 1.0


class Outcome(NamedTuple):
    """How a run ended."""

    exit_code: int
    message: str
    stamp_ns: int


class RunEnd:
    """Watches the track of one run, piece by piece."""

    def __init__(self, stop: StopParams, start: Trajectory):
        """Start at a track of one row."""
        self._stop = stop
        self._begin_ns = int(start.stamp_ns[-1])
        self._last = start
        self._travelled = 0.0
        self._moved = False
        self._still_s = 0.0

    @property
    def standing(self) -> bool:
        """Whether the car has stood still for a second."""
        return self._still_s >= _STANDSTILL_S

    def watch(self, track: Trajectory) -> Outcome | None:
        """Return how the run ended within these rows, or None. Call once per piece of track."""
        crossed_ns = self._crossing(track)
        self._watch_standstill(track)
        self._last = Trajectory(track.stamp_ns[-1:], track.rows[-1:])
        now_ns = int(track.stamp_ns[-1])
        if crossed_ns is not None:
            seconds = (crossed_ns - self._begin_ns) / NS_PER_S
            return Outcome(FINISHED, f'finish line crossed after {seconds:.3f} s', crossed_ns)
        if (now_ns - self._begin_ns) / NS_PER_S >= self._stop.time_s:
            message = f'finish line not reached within {self._stop.time_s:g} s'
            return Outcome(FAILED, message, now_ns)
        if self.standing and self._moved:
            return Outcome(FAILED, 'the car stands still', now_ns)
        return None

    def _crossing(self, track: Trajectory) -> int | None:
        """Return the stamp of the first row behind the line, coming from before it."""
        X = np.concatenate([self._last.column('planar.X'), track.column('planar.X')])
        Y = np.concatenate([self._last.column('planar.Y'), track.column('planar.Y')])
        travelled = self._travelled + np.cumsum(np.hypot(np.diff(X), np.diff(Y)))
        self._travelled = float(travelled[-1])
        stop = self._stop
        ahead = (X - stop.x_m) * math.cos(stop.yaw_rad) + (Y - stop.y_m) * math.sin(stop.yaw_rad)
        crossed = (ahead[:-1] < 0) & (ahead[1:] >= 0) & (travelled >= stop.armed_after_m)
        return int(track.stamp_ns[np.argmax(crossed)]) if crossed.any() else None

    def _watch_standstill(self, track: Trajectory) -> None:
        speed = np.hypot(track.column('planar.vx'), track.column('planar.vy'))
        stands = speed < _STANDSTILL_MPS
        step_s = (
            track.stamp_ns - np.concatenate([self._last.stamp_ns, track.stamp_ns[:-1]])
        ) / NS_PER_S
        if stands.all():
            self._still_s += float(step_s.sum())
        else:
            last_moving = np.flatnonzero(~stands)[-1]
            self._still_s = float(step_s[last_moving + 1 :].sum())
            self._moved = True
