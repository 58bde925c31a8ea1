"""CasADi functions as machine code: same functions, same results, two to five times faster.

The C source of the functions is the key of the cache (`compiled`), so nothing is compiled
again until the problem itself changes: numbers such as weights and limits are arguments.
"""

import functools
import warnings

import casadi as ca

from stage_solver import compile_cache, reuse

# no -ffast-math and no fused multiply-add, so that interpreter and machine code agree
FLAGS = ('-O2', '-ffp-contract=off')


def compile_functions(
    functions: dict[str, ca.Function], name: str, flags: tuple[str, ...] = FLAGS
) -> dict[str, ca.Function]:
    """Return the functions loaded from a shared library called `name`.

    Without a working C compiler the functions come back as they are, with one warning.
    """
    try:
        library = compile_cache.compile_library(c_source(functions, name), name, flags)
    except compile_cache.CompileError as error:
        warnings.warn(f'{error}\nthe interpreter is used instead', RuntimeWarning, stacklevel=2)
        return functions
    if library is None:
        compile_cache.warn_no_compiler(
            'the control problem is interpreted, two to five times slower'
        )
        return functions
    return {name: ca.external(name, str(library)) for name in functions}


def c_source(functions: dict[str, ca.Function], name: str) -> str:
    """Return one C file with all functions; code they share is in it once."""
    return _c_source(tuple(functions.values()), name)


@functools.lru_cache(reuse.MOST)  # of the same objects, not of equal ones
def _c_source(functions, name):
    generator = ca.CodeGenerator(name)
    for function in functions:
        generator.add(function)
    return generator.dump()
