"""Wall time that does not jump when the system clock is set."""

import time

READINGS = 5


class SteadyClock:
    """Wall time at construction plus the monotonic time since."""

    def __init__(self):
        # the process may be paused between two readings: the tightest of several counts
        clocks = time.monotonic_ns, time.time_ns, time.monotonic_ns
        readings = [[clock() for clock in clocks] for _ in range(READINGS)]
        before_ns, wall_ns, after_ns = min(readings, key=lambda times: times[2] - times[0])
        self._offset_ns = wall_ns - (before_ns + after_ns) // 2

    def now_ns(self) -> int:
        """Return the present wall time [ns]."""
        return time.monotonic_ns() + self._offset_ns
