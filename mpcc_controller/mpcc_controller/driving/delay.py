"""How long after a state was true its command takes hold. SI units; no clock is read here."""

from collections import deque
from statistics import median

from mpcc_controller.parameters import Delay

REMEMBERED = 20  # computing times, 1 s of ticks: adapts to a busy machine, ignores an outlier


class Expected:
    """Expects the next computing time from the last ones; the parameters until there are some."""

    def __init__(self, rules: Delay):
        self._rules = rules
        self._computing_s = deque(maxlen=REMEMBERED)

    def after(self, age_s: float) -> float:
        """Return the delay [s] of the command that answers a state of this age [s].

        Age now, computing, and the way to the actuators; at most `rules.longest_s`.
        """
        computing_s = self._rules.computing_s
        if self._computing_s:
            computing_s = median(self._computing_s)
        delay_s = age_s + computing_s + self._rules.transport_s
        return min(max(delay_s, 0.0), self._rules.longest_s)

    def took(self, computing_s: float) -> None:
        """Take what a step took."""
        self._computing_s.append(computing_s)
