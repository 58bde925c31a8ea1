"""The assembled NLP against the problem written out stage by stage, and against differences."""

import dataclasses

import casadi as ca
import numpy as np
import pytest
import small_problems

from stage_solver import nlp_functions, stage_functions
from stage_solver.nlpsol_solver import NlpLayout

SOLVERS = ('fatrop', 'ipopt')


@pytest.fixture
def point(slalom):
    """Return a plan that satisfies nothing, its v, p and multipliers."""
    rng = np.random.default_rng(7)
    X = slalom.guess.X + 0.3 * rng.standard_normal((31, 4))
    U = rng.standard_normal((30, 2))
    P = slalom.P + 0.1 * rng.standard_normal((31, 4))
    lam_g = rng.standard_normal(30 * (4 + 2) + 1)
    return X, U, P, NlpLayout(slalom.problem).pack(X, U), lam_g


@pytest.fixture(params=SOLVERS)
def functions(request, slalom):
    return nlp_functions.build(slalom.problem, request.param)


def flat(value):
    return value.full().ravel()


def test_cost_and_constraints_are_those_of_the_stages(slalom, point, functions):
    X, U, P, v, _ = point
    problem, cost, rows = slalom.problem, 0.0, []
    for k in range(30):
        cost += float(problem.stage_cost(X[k], U[k], P[k]))
        step = flat(problem.dynamics(X[k], U[k], P[k]))
        rows += [(X[k + 1] - step) / problem.scale_x, flat(problem.constraints(X[k], U[k], P[k]))]
    cost += float(problem.terminal_cost(X[30], P[30]))
    rows.append(flat(problem.terminal_constraints(X[30], P[30])))
    assert float(functions['nlp_f'](v, P.ravel())) == pytest.approx(cost, rel=1e-12)
    assert np.allclose(flat(functions['nlp_g'](v, P.ravel())), np.concatenate(rows), atol=1e-12)


def test_derivatives_agree_with_central_differences(point, functions):
    _, _, P, v, lam_g = point
    p, h = P.ravel(), 1e-6
    columns = range(0, len(v), 7)  # 7 is coprime to the 6 variables of a stage: all kinds, all over

    def difference(of):
        return np.column_stack(
            [
                (of(v + h * e) - of(v - h * e)) / (2 * h)
                for e in (np.eye(len(v))[i] for i in columns)
            ]
        )

    def slope(v):
        return flat(functions['nlp_grad'](v, p, 0.7, lam_g)[2])

    gradient = functions['nlp_grad_f'].call({'x': v, 'p': p})['grad_f_x']
    jacobian = functions['nlp_jac_g'](v, p)[1].full()
    hessian = functions['nlp_hess_l'](v, p, 0.7, lam_g)
    hessian = hessian[1].full() if isinstance(hessian, tuple) else np.triu(hessian.full())
    expected = difference(slope)
    if np.array_equal(hessian, np.triu(hessian)):
        hessian = hessian + np.triu(hessian, 1).T
    assert np.allclose(
        flat(gradient)[columns], difference(lambda v: flat(functions['nlp_f'](v, p)))[0], atol=1e-6
    )
    assert np.allclose(
        jacobian[:, columns], difference(lambda v: flat(functions['nlp_g'](v, p))), atol=1e-7
    )
    assert np.allclose(hessian[:, columns], expected, atol=1e-6)


def test_slope_of_the_lagrangian_is_gradient_plus_multiplied_jacobian(point, functions):
    _, _, P, v, lam_g = point
    p = P.ravel()
    f, g, slope, _ = functions['nlp_grad'](v, p, 0.7, lam_g)
    gradient = flat(functions['nlp_grad_f'].call({'x': v, 'p': p})['grad_f_x'])
    jacobian = functions['nlp_jac_g'](v, p)[1].full()
    assert np.allclose(flat(slope), 0.7 * gradient + jacobian.T @ lam_g, atol=1e-11)
    assert float(f) == pytest.approx(float(functions['nlp_f'](v, p)), rel=1e-14)
    assert np.allclose(flat(g), flat(functions['nlp_g'](v, p)), atol=1e-14)


def test_the_hessian_of_fatrop_is_zero_where_the_cost_has_no_weight(slalom, point):
    _, _, P, v, lam_g = point
    fatrop, ipopt = (nlp_functions.build(slalom.problem, s)['nlp_hess_l'] for s in SOLVERS)
    slope, none = fatrop(v, P.ravel(), 0.0, lam_g)
    assert not flat(none).any()
    assert flat(slope).any()
    assert flat(ipopt(v, P.ravel(), 0.0, lam_g)).any()
    _, some = fatrop(v, P.ravel(), 1e-3, lam_g)
    assert np.allclose(np.triu(some.full()), ipopt(v, P.ravel(), 1e-3, lam_g).full())


def test_patterns_hold_nothing_but_the_blocks_of_the_stages(slalom):
    functions = nlp_functions.build(slalom.problem, 'fatrop')
    expanded = functions['nlp'].expand()
    v, p = (ca.SX.sym(n, s) for n, s in zip('vp', (expanded.nnz_in(0), expanded.nnz_in(1))))
    _, g = expanded(v, p)
    assert functions['nlp_jac_g'].sparsity_out(1) == ca.jacobian(g, v).sparsity()
    hessian = functions['nlp_hess_l'].sparsity_out(1)
    rows, columns = np.array(hessian.row()), np.array(hessian.get_col())
    assert (rows // 6 == columns // 6).all()
    assert hessian.is_symmetric()


def test_an_infinite_derivative_counts_as_none(slalom):
    problem = slalom.problem
    x, u, p = (problem.dynamics.sx_in(i) for i in range(3))
    root = ca.Function('g', [x, u, p], [ca.vertcat(ca.sqrt(u[0]), u[1])])
    stage = stage_functions.make_stage(dataclasses.replace(problem, constraints=root))
    jacobian = flat(stage.jacobian(np.zeros(6), np.zeros(4))[1])
    hessian = flat(stage.hessian(np.zeros(6), np.zeros(4), 1.0, np.ones(6), np.zeros(4))[1])
    assert np.isfinite(jacobian).all()
    assert np.isfinite(hessian).all()
    assert np.abs(jacobian).max() > 0


@pytest.mark.parametrize('solver', SOLVERS)
def test_values_and_gradients_are_dense_also_without_parameters_and_terminal_cost(solver):
    """nlpsol reads them as dense arrays: entries that are not written would be random numbers."""
    functions = nlp_functions.build(small_problems.without_parameters(), solver)
    for name, output in (('nlp_f', 'f'), ('nlp_g', 'g'), ('nlp_grad_f', 'grad_f_x')):
        assert functions[name].sparsity_out(output).is_dense(), output
