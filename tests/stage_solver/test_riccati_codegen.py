"""Generated C against CasADi's own evaluation, lane by lane."""

import ctypes

import casadi as ca
import numpy as np
import pytest
from small_problems import aligned, slalom

from stage_solver import compile_cache, riccati_codegen, vector_codegen

LANES = 8
STAGES = 24  # lanes in the arrays: three groups

x, p = ca.SX.sym('x', 3), ca.SX.sym('p', 2)
a, b, c = ca.vertsplit(x)
m, n = ca.vertsplit(p)
OPERATIONS = {
    'arithmetic': [a + b, a - b, a * b, a / b, -a, a**2, 2 * a, 1 / b, a**3, b**-2, b**0.5],
    'elementary': [ca.sin(a), ca.cos(a), ca.tan(a), ca.exp(a), ca.log(b), ca.sqrt(b), ca.tanh(a)],
    'inverse': [ca.atan(a), ca.atan2(a, b), ca.asin(a / 4), ca.acos(a / 4), ca.asinh(a)],
    'library': [ca.sinh(a), ca.cosh(a), ca.erf(a), ca.log1p(b), ca.expm1(a), ca.power(b, c)],
    'kinks': [ca.fabs(a), ca.fmin(a, c), ca.fmax(a, c), ca.sign(a), ca.floor(a), ca.ceil(a)],
    'branches': [
        ca.if_else(a < c, a, b),
        ca.if_else(ca.logic_and(a <= c, a != 0), ca.sqrt(b), -b),
        ca.if_else(ca.logic_or(a > 1, ca.logic_not(c < 0)), a * c, ca.log(b)),
        (a < c) + 2 * (a == c),
        ca.if_else(a > 0, ca.sqrt(a), 0),
        ca.if_else(a > 0, ca.log(a), 7),
    ],
    'parameters': [ca.sin(m) * a, m * n + a, ca.if_else(m > n, a, b), ca.exp(n), m, n < m],
}


def compiled_function(function):
    """Return the C of a function of p and others, as a function of arrays (rows, STAGES)."""
    name = function.name()
    graph = vector_codegen.ExpressionGraph([function], {'p'})
    emitter = vector_codegen.Emitter(graph, 'stage', str(STAGES))
    others = [i for i in function.name_in() if i != 'p'] + function.name_out()
    names = ['p', 'once', *others]
    given, moved = (', '.join(f'{kind}{n}' for n in names) for kind in ('double *', 'j + '))
    entry = (
        f'void run({given}) {{ for (int j = 0; j < {STAGES}; j += W) {{'
        f'stage_once(j + p, j + once); {name}({moved}); }} }}'
    )
    source = riccati_codegen.template('vector_math.h') + emitter.source() + entry
    flags = (*riccati_codegen.FLAGS, f'-DW={LANES}')
    library = ctypes.CDLL(str(compile_cache.compile_library(source, 'codegen', flags)))
    rows = {n: function.numel_in(i) for i, n in enumerate(function.name_in())}
    rows |= {'once': len(emitter.once_rows)}
    rows |= {n: function.nnz_out(i) for i, n in enumerate(function.name_out())}

    def call(**inputs):
        arrays = {n: aligned(rows[n], STAGES) for n in names}
        for n, value in inputs.items():
            arrays[n][...] = value
        library.run(*(ctypes.c_void_p(v.ctypes.data) for v in arrays.values()))
        return [arrays[n] for n in function.name_out()]

    return call


@pytest.mark.parametrize('kind', OPERATIONS)
def test_every_operation_computes_what_casadi_computes(kind):
    function = ca.Function('stage', [x, p], [ca.vertcat(*OPERATIONS[kind])], ['x', 'p'], ['y'])
    rng = np.random.default_rng(2)
    X = rng.uniform([-2, 0.1, -2], [2, 4, 2], (STAGES, 3)).T
    X[0, :3] = X[2, :3]  # ties of the comparisons
    P = rng.uniform(-2, 2, (2, STAGES))
    expected = np.column_stack([function(X[:, k], P[:, k]).full().ravel() for k in range(STAGES)])
    assert np.allclose(compiled_function(function)(x=X, p=P)[0], expected, rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize('last', [False, True])
def test_stage_functions_and_derivatives_are_those_of_casadi(last):
    for function in riccati_codegen.make_stage(slalom().problem, last):
        rng = np.random.default_rng(4)
        sizes = {n: function.numel_in(i) for i, n in enumerate(function.name_in())}
        inputs = {n: rng.uniform(-1, 1, (size, STAGES)) for n, size in sizes.items()}
        values = compiled_function(function)(**inputs)
        for k in range(STAGES):
            at_k = function.call([inputs[n][:, k] for n in function.name_in()])
            for mine, reference in zip(values, at_k):
                assert np.allclose(mine[:, k], reference.nz[:].full().ravel(), 1e-12, 1e-13)


def test_hessian_and_gradients_agree_with_central_differences_and_hold_the_barrier():
    model = riccati_codegen.make_stage(slalom().problem)
    rng = np.random.default_rng(6)
    w, p = rng.uniform(-1, 1, 6), slalom().P[0]
    lam, y, sigma, push = (rng.uniform(-1, 1, size) for size in (4, 2, 8, 8))
    q, H, JF, Jg = (v.full() for v in model.quadratic(w, p, lam, y, sigma, push))

    def differences(of):
        steps = 1e-5 * np.eye(6)
        return np.column_stack([(of(w + d) - of(w - d)).full().ravel() / 2e-5 for d in steps])

    F, cost, g = (differences(lambda w, i=i: model.values(w, p)[i]) for i in range(3))
    assert np.allclose(F, JF, atol=1e-8)
    assert np.allclose(g, Jg, atol=1e-7)
    assert np.allclose(cost.ravel() + push[:6] + Jg.T @ push[6:], q.ravel(), atol=1e-8)
    slope = differences(lambda w: model.slope(w, p, lam, y))
    barrier = np.diag(sigma[:6]) + Jg.T @ np.diag(sigma[6:]) @ Jg
    assert np.allclose(slope + barrier, np.triu(H) + np.triu(H, 1).T, atol=1e-7)


def graph_of(*outputs):
    functions = [
        ca.Function(f'f{k}', [x, p], [output], ['x', 'p'], ['y'])
        for k, output in enumerate(outputs)
    ]
    return vector_codegen.ExpressionGraph(functions, {'p'})


def test_what_only_parameters_decide_is_computed_once():
    text = vector_codegen.Emitter(graph_of(ca.sin(m) * a + ca.cos(m + n)), 'stage', '8').source()
    once, stage = text.split('static void f0(')
    for name in ('v_sin', 'v_cos'):
        assert (once.count(name), stage.count(name)) == (1, 0)


@pytest.mark.parametrize(
    ('outputs', 'operation', 'count'),
    [
        pytest.param((ca.sin(a * b) + 1, ca.sin(b * a) * 2), ca.OP_SIN, 1, id='equal operations'),
        pytest.param((a / c, b / c, 1 / c), ca.OP_INV, 1, id='quotients of a number'),
        pytest.param((a / c, b / c, 1 / c), ca.OP_MUL, 2, id='no product with 1'),
        pytest.param((a**8, a**4), ca.OP_SQ, 3, id='powers by squares'),
    ],
)
def test_operations_are_shared(outputs, operation, count):
    nodes = graph_of(*outputs).nodes
    assert sum(node.op == operation for node in nodes) == count


def test_an_operation_without_counterpart_is_named():
    with pytest.raises(vector_codegen.UnsupportedError, match='is not supported'):
        vector_codegen.Emitter(graph_of(ca.remainder(a, b)), 'stage', '8').source()


def test_the_same_problem_gives_the_same_source():
    made = riccati_codegen.source.__wrapped__  # nothing is kept
    assert made(slalom().problem) == made(slalom().problem)
