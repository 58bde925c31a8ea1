"""The queries of path and road edges as machine code (queries.c), for the callers in this folder.

Each function of the C file does what the numpy function of the same purpose does, to rounding; the
numpy functions define the results and replace the machine code where there is no C compiler.
"""

import ctypes
import warnings
from functools import cache
from pathlib import Path

import numpy as np

from stage_solver import compile_cache

PROJECTION_STEPS = 3  # Newton steps of a projection; each squares the error, below 1 m at first
S_PENALTY = 1e-3  # m of distance per m along the path, to choose between equally close points
ROUNDING = 1e-6  # m, more than that of a distance on any road
# no fused multiply-add and no CPU-specific code: the same bits on every x86-64 machine
FLAGS = (
    *('-O2', '-fno-math-errno', '-ffp-contract=off'),
    f'-DPROJECTION_STEPS={PROJECTION_STEPS}',
    f'-DS_PENALTY={S_PENALTY!r}',
    f'-DROUNDING={ROUNDING!r}',
)
SOURCE = Path(__file__).with_name('queries.c')
POINTER, LONG, DOUBLE = ctypes.c_void_p, ctypes.c_long, ctypes.c_double
ARGUMENTS = {
    'make_discs': (LONG, POINTER, POINTER, POINTER),
    'path_at': (LONG, POINTER, LONG, POINTER, POINTER),
    'path_project': (LONG, POINTER, DOUBLE, DOUBLE, DOUBLE, DOUBLE),
    'path_refine': (LONG, POINTER, LONG, POINTER, POINTER, POINTER, POINTER),
    'path_to_frenet': (LONG, POINTER, POINTER, LONG, POINTER, POINTER, DOUBLE, POINTER, POINTER),
    'edge_beside': (LONG, POINTER, POINTER, LONG, POINTER, POINTER, DOUBLE, POINTER),
}  # fmt: skip


@cache
def library() -> ctypes.CDLL | None:
    """Return the compiled queries, or None without a working C compiler, with one warning."""
    try:
        path = compile_cache.compile_library(SOURCE.read_text(), 'path_queries', FLAGS)
    except compile_cache.CompileError as error:
        warnings.warn(f'{error}\nnumpy is used instead', RuntimeWarning, stacklevel=2)
        return None
    if path is None:
        compile_cache.warn_no_compiler('path and road are evaluated by numpy, several times slower')
        return None
    loaded = ctypes.CDLL(str(path))
    loaded.disc_count.restype, loaded.disc_count.argtypes = LONG, (LONG,)
    for name, arguments in ARGUMENTS.items():
        function = getattr(loaded, name)
        function.restype = DOUBLE if name == 'path_project' else None
        function.argtypes = arguments
    return loaded


def make_discs(X: np.ndarray, Y: np.ndarray) -> np.ndarray | None:
    """Return discs (3, m) around blocks of the chords between points (n,); None uncompiled."""
    compiled = library()
    if compiled is None:
        return None
    X, Y = row(X), row(Y)
    discs = np.empty((3, compiled.disc_count(len(X) - 1)))
    compiled.make_discs(len(X), X.ctypes.data, Y.ctypes.data, discs.ctypes.data)
    return discs


def row(values) -> np.ndarray:
    """Return numbers as a contiguous array of floats, of the same shape."""
    return np.asarray(values, float, order='C')
