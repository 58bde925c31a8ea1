"""Which moment of a bag it is at an instant of the wall clock. It reads no clock itself."""

from msgs_yaml.stamp import NS_PER_S


class Pace:
    """Moves through a bag at `rate` s per second of wall time; stands still while paused.

    Times are ns: `now_ns` of any steady clock, positions from the start of what is played.
    """

    def __init__(self, rate: float, now_ns: int, paused: bool = False):
        self.rate = rate
        self.paused = paused
        self._at_ns, self._since_ns = 0, now_ns

    def position_ns(self, now_ns: int) -> int:
        """Return the moment of the bag."""
        if self.paused:
            return self._at_ns
        return self._at_ns + round((now_ns - self._since_ns) * self.rate)

    def wait_s(self, due_ns: int, now_ns: int) -> float | None:
        """Return how long it is until a moment of the bag, at most 0 when it has come.

        None while paused before it: only a key brings it nearer.
        """
        ahead_ns = due_ns - self.position_ns(now_ns)
        if self.paused and ahead_ns > 0:
            return None
        return ahead_ns / self.rate / NS_PER_S

    def toggle(self, now_ns: int) -> None:
        """Pause, or go on from where the pause or its last step ended."""
        self._at_ns, self._since_ns = self.position_ns(now_ns), now_ns
        self.paused = not self.paused

    def step(self, length_ns: int, next_ns: int, now_ns: int) -> None:
        """Pause and let another `length_ns` of the bag come, at least up to `next_ns`."""
        if not self.paused:
            self.toggle(now_ns)
        self._at_ns = max(self._at_ns + length_ns, next_ns)
