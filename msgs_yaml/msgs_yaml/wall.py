"""Wall time that runs steadily: setting the system's clock is no jump of the nodes that run."""

import time


class Wall:
    """The wall time at which this was made, and the steady time since."""

    def __init__(self):
        self._offset_ns = time.time_ns() - time.monotonic_ns()

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
