"""Wall time that runs steadily: setting the system's clock is no jump of the nodes that run."""

import time

LOOKS = 5  # at both clocks


class Wall:
    """The wall time at which this was made, and the steady time since."""

    def __init__(self):
        # a pause of this process between two looks would be an error for good: the closest count
        clocks = time.monotonic_ns, time.time_ns, time.monotonic_ns
        readings = [[clock() for clock in clocks] for _ in range(LOOKS)]
        before_ns, wall_ns, after_ns = min(readings, key=lambda one: one[2] - one[0])
        self._offset_ns = wall_ns - (before_ns + after_ns) // 2

    def now_ns(self) -> int:
        """Return the present time [ns]."""
        return time.monotonic_ns() + self._offset_ns


class Spoken:
    """Lets a line pass when it is not the one before: once per change."""

    def __init__(self):
        self._last = ''

    def is_news(self, line: str) -> bool:
        """Tell whether a line is to be said."""
        news, self._last = line != self._last, line
        return news
