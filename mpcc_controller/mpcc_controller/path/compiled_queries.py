"""The queries of path, road edges and lines as machine code: queries.c."""

import ctypes
from functools import cache
from pathlib import Path

import numpy as np

from stage_solver import compile_cache

# no fused multiply-add and no CPU-specific code: the same bits on every x86-64 machine
FLAGS = ('-O2', '-fno-math-errno', '-ffp-contract=off')
SOURCE = Path(__file__).with_name('queries.c')
POINTER, LONG, DOUBLE = ctypes.c_void_p, ctypes.c_long, ctypes.c_double
START = ctypes.c_char * 0  # of an array
ARGUMENTS = {
    'make_discs': (LONG, POINTER, POINTER, POINTER),
    'path_at': (LONG, POINTER, LONG, POINTER, POINTER),
    'path_project': (LONG, POINTER, DOUBLE, DOUBLE, DOUBLE, DOUBLE),
    'path_refine': (LONG, POINTER, LONG, POINTER, POINTER, POINTER, POINTER),
    'path_to_frenet': (LONG, POINTER, POINTER, LONG, POINTER, POINTER, DOUBLE, POINTER, POINTER),
    'interpolate': (LONG, LONG, POINTER, LONG, POINTER, POINTER, POINTER),
    'edge_beside': (LONG, POINTER, POINTER, LONG, POINTER, POINTER, DOUBLE, POINTER),
}  # fmt: skip


@cache
def library() -> ctypes.CDLL:
    """Return the compiled queries. Raises CompileError."""
    path = compile_cache.compile_library(SOURCE.read_text(), 'path_queries', FLAGS)
    loaded = ctypes.CDLL(str(path))
    loaded.disc_count.restype, loaded.disc_count.argtypes = LONG, (LONG,)
    for name, arguments in ARGUMENTS.items():
        function = getattr(loaded, name)
        function.restype = DOUBLE if name == 'path_project' else None
        function.argtypes = arguments
    return loaded


def call(name: str, *arguments: np.ndarray | float):
    """Return what a query returns; arrays, of `row`, are passed by their addresses."""
    try:  # takes a third of the time of the attribute `ctypes`, 30 times per tick
        given = [START.from_buffer(a) if type(a) is np.ndarray else a for a in arguments]
    except TypeError:  # an array that is read-only
        given = [a.ctypes.data if type(a) is np.ndarray else a for a in arguments]
    return getattr(library(), name)(*given)


def make_discs(X: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """Return discs (3, m) around blocks of the chords between points (n,)."""
    X, Y = row(X), row(Y)
    discs = np.empty((3, call('disc_count', len(X) - 1)))
    call('make_discs', len(X), X, Y, discs)
    return discs


def row(values) -> np.ndarray:
    """Return numbers as a contiguous array of floats, of the same shape."""
    return np.asarray(values, float, order='C')


def interpolate(x: np.ndarray, points: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return `numpy.interp` of every row: at x (r, k), of values (r, n) at ascending points."""
    x, points, values = row(x), row(points), row(values)
    out = np.empty_like(x)
    call('interpolate', *x.shape, x, points.shape[1], points, values, out)
    return out
