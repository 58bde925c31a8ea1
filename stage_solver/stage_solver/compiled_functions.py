"""CasADi functions as machine code: same functions, same results, two to five times faster.

Their C source is the key of `compile_cache`: nothing is compiled again until the problem itself
changes. Weights and limits are arguments.
"""

import functools
import warnings

import casadi as ca

from stage_solver import compile_cache
from stage_solver.stage_problem import MAX_CACHED_PROBLEMS

# no -ffast-math and no fused multiply-add, so that interpreter and machine code agree
FLAGS = ('-O2', '-ffp-contract=off')


def compile_functions(
    functions: dict[str, ca.Function], name: str, flags: tuple[str, ...] = FLAGS
) -> dict[str, ca.Function]:
    """Return the functions loaded from a shared library called `name`.

    Returns `functions` unchanged, with one warning, where there is no working C compiler.
    """
    try:
        source = c_source(tuple(functions.values()), name)
        library = compile_cache.compile_library(source, name, flags)
    except compile_cache.CompileError as error:
        warnings.warn(f'{error}\nthe interpreter is used instead', RuntimeWarning, stacklevel=2)
        return functions
    if library is None:
        consequence = 'the control problem is interpreted, two to five times slower'
        compile_cache.warn_no_compiler(consequence)
        return functions
    return {name: ca.external(name, str(library)) for name in functions}


@functools.lru_cache(MAX_CACHED_PROBLEMS)  # CasADi functions are compared by identity
def c_source(functions: tuple[ca.Function, ...], name: str) -> str:
    """Return one C file with all functions; it contains code that they share once."""
    generator = ca.CodeGenerator(name)
    for function in functions:
        generator.add(function)
    return generator.dump()
