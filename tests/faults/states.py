"""The state in which a car ended, and since when, from its motion and the controller's reports.

Every 50 ms from the fault to the end of the run the car is in one state:

    stopped   slower than 0.3 m/s: a car that stops rocks on its tyres
    braking   the controller is on its last fallback level, or the car decelerates by 2 m/s^2
    degraded  the plan followed is not that of the present tick, or no report says which it is
    OK        otherwise

The last one is the final state; it is settled when no other state follows it.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

GRID_NS = 50_000_000
MAX_REPORT_AGE_NS = 300_000_000  # of the controller
STANDSTILL_MPS = 0.3
BRAKING_MPS2 = 2.0
WINDOW_NS = 100_000_000  # over which a deceleration is measured
PLANNED = ('solved', 'stopped_early')


class FinalState(NamedTuple):
    """The final state of a run and the states before it."""

    state: str
    settled_s: float  # from the fault until the final state was kept
    visited: tuple[str, ...]  # all states in their order


class Drive:
    """What was heard of a drive: speeds of the car, levels of fallback; instants in ns."""

    def __init__(self):
        self.speeds: list[tuple[int, float]] = []  # m/s
        self.reports: list[tuple[int, str]] = []

    def state_at(self, now_ns: int, plant_lives: bool = True) -> str:
        """Return the state at an instant; a plant that does not live tells no deceleration."""
        at_ns, speeds = (np.array(column) for column in zip(*self.speeds))
        sample = np.searchsorted(at_ns, now_ns, side='right') - 1
        if speeds[sample] < STANDSTILL_MPS:
            return 'stopped'
        before = np.searchsorted(at_ns, at_ns[sample] - WINDOW_NS)
        elapsed_s = (at_ns[sample] - at_ns[before]) / 1e9
        is_known = plant_lives and 0.0 < elapsed_s <= 2 * WINDOW_NS / 1e9
        level = self._level(now_ns)
        if level in ('recovery', 'braking') or (
            is_known and speeds[before] - speeds[sample] > BRAKING_MPS2 * elapsed_s
        ):
            return 'braking'
        return 'OK' if level in PLANNED else 'degraded'

    def _level(self, now_ns):
        at_ns = [report_ns for report_ns, _ in self.reports]
        last = np.searchsorted(at_ns, now_ns, side='right') - 1
        is_recent = last >= 0 and now_ns - at_ns[last] <= MAX_REPORT_AGE_NS
        return self.reports[last][1] if is_recent else None

    def final_state(self, begins_ns: int, plant_lives: bool = True) -> FinalState:
        """Return the final state after a fault that begins at an instant.

        The run ends with the last speed, without a plant with the last report.
        """
        end_ns = (self.speeds if plant_lives else self.reports)[-1][0]
        assert begins_ns < end_ns, 'the fault begins after the end'
        instants = np.arange(end_ns, begins_ns - 1, -GRID_NS)[::-1]
        visited = [self.state_at(now_ns, plant_lives) for now_ns in instants]
        changes = [k for k, (a, b) in enumerate(pairwise(visited), 1) if a != b]
        settled_ns = instants[changes[-1]] - begins_ns if changes else 0
        return FinalState(visited[-1], settled_ns / 1e9, tuple(visited[k] for k in (0, *changes)))
