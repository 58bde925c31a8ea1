"""The growth of a Riccati recursion against its scalar formula, and what fatrop gets beyond it."""

import casadi as ca
import numpy as np
import pytest

from stage_solver import fatrop_guard, nlp_functions, stage_functions
from stage_solver.stage_problem import StageProblem

HORIZON = 12


def scalar(a, b, c, e):
    """Return the problem x+ = a x + b u with constraints c x + u at each stage, e x at the last."""
    x, u, p = (ca.SX.sym(name) for name in 'xup')
    return StageProblem(
        name='scalar',
        states=('x',),
        inputs=('u',),
        parameters=('p',),
        horizon=HORIZON,
        dynamics=ca.Function('F', [x, u, p], [a * x + b * u]),
        stage_cost=ca.Function('l', [x, u, p], [x**2 + u**2]),
        terminal_cost=ca.Function('m', [x, p], [x**2]),
        constraints=ca.Function('g', [x, u, p], [c * x + u]),
        terminal_constraints=ca.Function('h', [x, p], [e * x]),
        scale_x=(1.0,),
        scale_u=(1.0,),
    )


def jacobian(problem, solver):
    v, p = np.ones(2 * HORIZON + 1), np.zeros(HORIZON + 1)
    return nlp_functions.build(problem, solver)['nlp_jac_g'](v, p)[1].full()


def growth(problem):
    stage, last = stage_functions.make_stage(problem), stage_functions.make_last_stage(problem)
    _, J = stage.jacobian.map(HORIZON)(np.ones((2, HORIZON)), np.zeros((1, HORIZON)))
    _, j_last = last.jacobian(1.0, 0.0)
    expression = fatrop_guard.growth(problem, stage, last, ca.MX(J), ca.MX(j_last))
    return float(ca.evalf(expression))


@pytest.mark.parametrize(
    ('a', 'b', 'c', 'e'), [(0.9, 0.5, 0.3, 2.0), (3.0, 0.0, 0.0, 0.0), (-7.0, 2.0, 5.0, 1.0)]
)
def test_growth_is_that_of_the_scalar_recursion(a, b, c, e):
    P = 1 + e**2
    expected = P
    for _ in range(HORIZON):
        xx, xu, uu = 1 + c**2 + a**2 * P, c + a * b * P, 2 + b**2 * P
        expected += xx + uu
        P = xx - xu**2 / uu
    assert growth(scalar(a, b, c, e)) == pytest.approx(expected, rel=1e-12)


def test_growth_that_overflows_is_not_below_the_bound():
    assert not growth(scalar(1e30, 0.0, 0.0, 0.0)) < fatrop_guard.MAX_GROWTH


def test_rounding_hides_no_large_jacobian(slalom):
    """Where the recursion itself loses its pivots, negative traces must not cancel large ones."""
    rng = np.random.default_rng(11)
    problem = slalom.problem
    stage = stage_functions.make_stage(problem)
    last = stage_functions.make_last_stage(problem)
    pattern = stage.jacobian_pattern
    dynamics = [i for i, row in enumerate(pattern.row()) if row >= problem.nx + problem.ng]
    J = ca.MX.sym('J', pattern.nnz(), problem.horizon)
    j_last = ca.MX.sym('j_last', last.jacobian_pattern.nnz())
    traces = fatrop_guard.growth(problem, stage, last, J, j_last)
    growth_of = ca.Function('growth', [J, j_last], [traces])
    for _ in range(200):
        decades = rng.uniform(-2, rng.uniform(4.5, 12), problem.horizon)
        values = rng.standard_normal(J.shape) * 10**decades
        k = rng.integers(problem.horizon)
        values[rng.choice(dynamics), k] = 1.01 * np.sqrt(fatrop_guard.MAX_GROWTH)
        size = float(growth_of(values, rng.standard_normal(j_last.shape)))
        assert not size < fatrop_guard.MAX_GROWTH


@pytest.mark.parametrize(('a', 'is_kept'), [(2.0, True), (10.0, False), (1e30, False)])
def test_fatrop_gets_only_jacobians_that_a_recursion_can_factorise(a, is_kept):
    """It would raise its inertia correction for ever: no limit of iterations or time ends it."""
    problem = scalar(a, 0.0, 0.5, 1.0)
    assert (growth(problem) < fatrop_guard.MAX_GROWTH) == is_kept
    whole, given = jacobian(problem, 'ipopt'), jacobian(problem, 'fatrop')
    next_states = np.zeros_like(whole)
    next_states[2 * np.arange(HORIZON), 2 * np.arange(1, HORIZON + 1)] = 1.0
    assert np.array_equal(given, whole if is_kept else next_states)
    assert not np.array_equal(whole, next_states)


def test_fatrop_gets_no_hessian_that_its_correction_cannot_outweigh(slalom):
    rng = np.random.default_rng(7)
    functions = nlp_functions.build(slalom.problem, 'fatrop')
    v, lam_g = rng.standard_normal(30 * 6 + 4), rng.standard_normal(30 * (4 + 2) + 1)
    size = nlp_functions.MAX_HESSIAN
    for scale, is_kept in ((1.0, True), (1e3 * size, False)):
        _, hessian = functions['nlp_hess_l'](v, slalom.P.ravel(), 1.0, scale * lam_g)
        assert hessian.full().any() == is_kept
