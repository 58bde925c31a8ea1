"""The vector functions against 80-bit arithmetic, and where numbers stop being ordinary."""

import ctypes

import numpy as np
import pytest

from stage_solver import compile_cache, riccati_codegen

NAMES = ('sin', 'cos', 'tan', 'atan', 'exp', 'log', 'tanh', 'sqrt')
EXACT = {'atan': np.arctan} | {n: getattr(np, n) for n in NAMES if n != 'atan'}
APPLY = """
void {0}_all(const double *x, double *y, long n)
{{
    for (long i = 0; i < n; i += W)
        *(V *)(y + i) = v_{0}(*(const V *)(x + i));
}}
"""
SPREAD = np.random.default_rng(0)
SMALL = SPREAD.uniform(-1, 1, 4096) * 10.0 ** SPREAD.uniform(-12, 0, 4096)
RANGES = {
    'sin': (SMALL, SPREAD.uniform(-8, 8, 4096), SPREAD.uniform(-9e5, 9e5, 4096)),
    'cos': (SMALL, SPREAD.uniform(-8, 8, 4096), SPREAD.uniform(-9e5, 9e5, 4096)),
    'tan': (SMALL, SPREAD.uniform(-1.5, 1.5, 4096), SPREAD.uniform(-100, 100, 4096)),
    'atan': (SMALL, SPREAD.uniform(-5, 5, 4096), 10.0 ** SPREAD.uniform(0, 300, 4096)),
    'exp': (SMALL, SPREAD.uniform(-3, 3, 4096), SPREAD.uniform(-708, 709, 4096)),
    'log': (1 + SMALL / 2, SPREAD.uniform(0, 10, 4096), 10.0 ** SPREAD.uniform(-300, 300, 4096)),
    'tanh': (SMALL, SPREAD.uniform(-3, 3, 4096), SPREAD.uniform(-800, 800, 4096)),
    'sqrt': (abs(SMALL), SPREAD.uniform(0, 10, 4096), 10.0 ** SPREAD.uniform(-300, 300, 4096)),
}


@pytest.fixture(scope='module', params=[2, 4, 8], ids='{} lanes'.format)
def vector(request):
    """Return the functions for numpy arrays, as compiled for vectors of so many lanes."""
    source = riccati_codegen.template('vector_math.h') + ''.join(APPLY.format(n) for n in NAMES)
    flags = (*riccati_codegen.FLAGS, f'-DW={request.param}')
    library = ctypes.CDLL(str(compile_cache.compile_library(source, 'vector_math', flags)))

    def call(name, x):
        padded = aligned(-(-len(x) // 8) * 8)
        padded[: len(x)] = x
        y = aligned(len(padded))
        function = getattr(library, f'{name}_all')
        pointers = (ctypes.c_void_p(a.ctypes.data) for a in (padded, y))
        function(*pointers, ctypes.c_long(len(padded)))
        return y[: len(x)].copy()

    return call


def aligned(n):
    memory = np.full(n + 8, 0.5)
    start = (-memory.ctypes.data % 64) // 8
    return memory[start : start + n]


@pytest.mark.parametrize('name', NAMES)
def test_error_is_a_few_units_in_the_last_place(vector, name):
    for x in RANGES[name]:
        exact = EXACT[name](x.astype(np.longdouble))
        error = np.abs(vector(name, x).astype(np.longdouble) - exact)
        # near a zero of sin, cos, tan the argument's own rounding is the unit
        unit = np.maximum(np.spacing(np.abs(exact.astype(float))), 1e-16 * 2.0**-52 * np.abs(x))
        assert np.max(error / unit) < 4


@pytest.mark.parametrize('name', NAMES)
def test_unusual_numbers_give_what_the_c_library_gives(vector, name):
    x = np.array([0.0, np.inf, -np.inf, np.nan, -1.0, 1e9, -3e15, 5e-324, 1e-310, 710.0, -746.0])
    with np.errstate(all='ignore'):
        expected = EXACT[name](x)
    solution = vector(name, x)
    assert np.array_equal(np.isnan(solution), np.isnan(expected))
    ordinary = np.isfinite(expected)
    assert np.array_equal(solution[~ordinary], expected[~ordinary], equal_nan=True)
    # a denormal result keeps its absolute precision only
    assert np.allclose(solution[ordinary], expected[ordinary], rtol=1e-15, atol=2e-323)


@pytest.mark.parametrize('name', NAMES)
def test_a_lane_does_not_see_its_neighbours(vector, name):
    x = np.full(64, 0.7)
    alone = vector(name, x)[0]
    x[1::2] = [np.nan, np.inf, -np.inf, 1e300] * 8
    assert np.all(vector(name, x)[::2] == alone)


def test_functions_are_continuous_where_their_formulas_change(vector):
    for name, at in (
        ('atan', 0.66),
        ('atan', 2.414213562373095),
        ('tanh', 0.625),
        ('sin', np.pi / 4),
    ):
        x = at + np.arange(-50, 50) * np.spacing(at)
        step = np.abs(np.diff(vector(name, x)))
        assert step.max() < 4 * np.spacing(1.0)
