"""The vector functions against 80-bit arithmetic, and where numbers stop being ordinary."""

import ctypes

import numpy as np
import pytest
from small_problems import aligned

from stage_solver import compile_cache, riccati_codegen

APPLY = """
void {0}_all(const double *x, double *y, long n)
{{
    for (long i = 0; i < n; i += W)
        *(V *)(y + i) = v_{0}(*(const V *)(x + i));
}}
"""
COUNT = 4096
SPREAD = np.random.default_rng(0)
SMALL = SPREAD.uniform(-1, 1, COUNT) * 10.0 ** SPREAD.uniform(-12, 0, COUNT)
LARGE = 10.0 ** SPREAD.uniform(-300, 300, COUNT)


def between(low, high):
    return SPREAD.uniform(low, high, COUNT)


RANGES = {
    'sin': (SMALL, between(-8, 8), between(-9e5, 9e5)),
    'cos': (SMALL, between(-8, 8), between(-9e5, 9e5)),
    'tan': (SMALL, between(-1.5, 1.5), between(-100, 100)),
    'atan': (SMALL, between(-5, 5), LARGE),
    'exp': (SMALL, between(-3, 3), between(-708, 709)),
    'log': (1 + SMALL / 2, between(0, 10), LARGE),
    'tanh': (SMALL, between(-3, 3), between(-800, 800)),
    'sqrt': (abs(SMALL), between(0, 10), LARGE),
}
EXACT = {name: getattr(np, {'atan': 'arctan'}.get(name, name)) for name in RANGES}
each_function = pytest.mark.parametrize('name', RANGES)


@pytest.fixture(scope='module', params=[2, 4, 8], ids='{} lanes'.format)
def vector(request):
    """Return the functions for numpy arrays, as compiled for vectors of so many lanes."""
    source = riccati_codegen.template('vector_math.h') + ''.join(map(APPLY.format, RANGES))
    flags = (*riccati_codegen.FLAGS, f'-DW={request.param}')
    library = ctypes.CDLL(str(compile_cache.compile_library(source, 'vector_math', flags)))

    def call(name, x):
        padded = aligned(-(-len(x) // 8) * 8)
        padded[: len(x)] = x
        y = aligned(len(padded))
        pointers = (ctypes.c_void_p(a.ctypes.data) for a in (padded, y))
        getattr(library, f'{name}_all')(*pointers, ctypes.c_long(len(padded)))
        return y[: len(x)].copy()

    return call


@each_function
def test_the_error_is_a_few_units_in_the_last_place(vector, name):
    # where the formulas change, too
    steps = np.arange(-50, 50) * np.spacing(1.0)
    corners = [at + steps for at in (0.625, 0.66, np.pi / 4, 2.414213562373095)]
    for x in (*RANGES[name], *corners):
        exact = EXACT[name](x.astype(np.longdouble))
        error = np.abs(vector(name, x).astype(np.longdouble) - exact)
        # near a zero of sin, cos, tan the argument's own rounding is the unit
        unit = np.maximum(np.spacing(np.abs(exact.astype(float))), 1e-16 * 2.0**-52 * np.abs(x))
        assert np.max(error / unit) < 4


@each_function
def test_unusual_numbers_give_what_the_c_library_gives(vector, name):
    x = np.array([0.0, np.inf, -np.inf, np.nan, -1.0, 1e9, -3e15, 5e-324, 1e-310, 710.0, -746.0])
    with np.errstate(all='ignore'):
        expected = EXACT[name](x)
    result, ordinary = vector(name, x), np.isfinite(expected)
    assert np.array_equal(result[~ordinary], expected[~ordinary], equal_nan=True)
    # a denormal result keeps its absolute precision only
    assert np.allclose(result[ordinary], expected[ordinary], rtol=1e-15, atol=2e-323)
