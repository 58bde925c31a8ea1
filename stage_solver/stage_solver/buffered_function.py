"""CasADi functions on preallocated arrays: a call without conversions and allocations."""

import casadi as ca
import numpy as np


class BufferedFunction:
    """A CasADi function on flat arrays, allocated once; each call overwrites the results."""

    def __init__(self, function: ca.Function):
        self._buffer, self._evaluate = function.buffer()
        names_in, names_out = function.name_in(), function.name_out()
        self.arguments = {n: np.zeros(function.nnz_in(n)) for n in names_in}
        self.results = {n: np.zeros(function.nnz_out(n)) for n in names_out}
        for i, name in enumerate(names_in):
            self._buffer.set_arg(i, memoryview(self.arguments[name]))
        for i, name in enumerate(names_out):
            self._buffer.set_res(i, memoryview(self.results[name]))

    def __call__(self, **values) -> dict[str, np.ndarray]:
        """Assign the given arguments, keep the values of the others, return the results."""
        for name, value in values.items():
            self.arguments[name][:] = value
        self._evaluate()
        return self.results

    def stats(self) -> dict:
        """Return CasADi's statistics of the last call."""
        return self._buffer.stats()
