"""CasADi functions as machine code, and their calls without conversions and allocations.

Compiled functions give the same results two to five times faster. Their C source is the key of
`compile_cache`: nothing is compiled again until the problem itself changes. Weights and limits are
arguments.
"""

import casadi as ca
import numpy as np

from stage_solver import compile_cache

# no -ffast-math and no fused multiply-add, so that interpreter and machine code agree
FLAGS = ('-O2', '-ffp-contract=off')


def compile_functions(
    functions: dict[str, ca.Function], name: str, flags: tuple[str, ...] = FLAGS
) -> dict[str, ca.Function]:
    """Return the functions loaded from a shared library called `name`.

    Raises CompileError without a working C compiler.
    """
    generator = ca.CodeGenerator(name)
    for function in functions.values():
        generator.add(function)
    library = compile_cache.compile_library(generator.dump(), name, flags)
    return {name: ca.external(name, str(library)) for name in functions}


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
