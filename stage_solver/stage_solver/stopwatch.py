"""How long a solve takes: for those who wait for it, and for the processor."""

import time
from typing import NamedTuple


class Stopwatch(NamedTuple):
    """The instant at which a solve began."""

    wall_s: float  # on the clock of time.perf_counter
    cpu_s: float  # processor time of the calling thread until then

    def took(self) -> dict[str, float]:
        """Return the times since, as fields of a Solution."""
        return {
            'solve_s': time.perf_counter() - self.wall_s,
            'cpu_s': time.thread_time() - self.cpu_s,
        }


def started() -> Stopwatch:
    """Start one now."""
    return Stopwatch(time.perf_counter(), time.thread_time())
