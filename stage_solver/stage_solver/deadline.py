"""A point in time after which a CasADi function returns NaN."""

import math
import time

import casadi as ca


class Deadline(ca.Callback):
    """A CasADi function of anything: 0 before the instant `at_s`, NaN after it."""

    def __init__(self):
        ca.Callback.__init__(self)
        self._at_s = math.inf
        self.passed = False  # it has returned NaN since `at_s` was set
        self.construct('deadline', {})

    @property
    def at_s(self) -> float:
        """The instant, in seconds on the clock of time.perf_counter."""
        return self._at_s

    @at_s.setter
    def at_s(self, instant_s: float):
        self._at_s = instant_s
        self.passed = False

    def eval(self, arg):
        """Return [0] or [NaN]; CasADi calls."""
        self.passed = self.passed or time.perf_counter() > self._at_s
        return [math.nan if self.passed else 0.0]

    def limit(self, function: ca.Function) -> ca.Function:
        """Return `function` with all its results NaN after the deadline."""
        arguments = [function.mx_in(i) for i in range(function.n_in())]
        late = self(ca.MX(0))
        results = [r + late for r in function.call(arguments)]
        names = function.name_in(), function.name_out()
        return ca.Function(function.name(), arguments, results, *names)
