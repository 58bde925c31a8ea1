"""The midpoint rule, the shift of a plan, equal and contradictory problems."""

import dataclasses
import functools

import casadi as ca
import numpy as np
import pytest
import small_problems
from hypothesis import given, settings
from hypothesis import strategies as st

from stage_solver.stage_problem import (
    MAX_CACHED_PROBLEMS,
    Multipliers,
    Plan,
    ProblemError,
    no_bounds,
    rk2,
    shift,
    zero_plan,
)


def pendulum(x, u, p):
    return np.array([x[1], -p * np.sin(x[0]) - 0.1 * x[1] + u])


def drive(dt, duration=2.0):
    step = rk2(pendulum, dt)
    x = np.array([1.0, 0.5])
    for _ in range(round(duration / dt)):
        x = step(x, 0.3, 9.81)
    return x


def test_error_over_a_fixed_time_falls_with_the_square_of_the_step():
    exact = drive(1e-4)
    coarse, half, quarter = (np.abs(drive(dt) - exact).max() for dt in (0.04, 0.02, 0.01))
    assert coarse / half == pytest.approx(4, rel=0.15)
    assert half / quarter == pytest.approx(4, rel=0.1)


def test_step_is_the_midpoint_rule_by_hand():
    # x' = x^2 at x = 1: midpoint 1 + 0.1/2 * 1 = 1.05, step 1 + 0.1 * 1.05^2
    step = rk2(lambda x, u, p: x**2, 0.1)
    assert step(1.0, None, None) == pytest.approx(1.11025, abs=1e-15)


@settings(max_examples=50)
@given(st.floats(0.05, 3.0))
def test_decay_is_stable_up_to_a_step_of_two_time_constants(a_dt):
    step = rk2(lambda x, u, p: -x, a_dt)
    x = 1.0
    for _ in range(100):
        x = step(x, None, None)
    factor = 1 - a_dt + a_dt**2 / 2
    assert x == pytest.approx(factor**100, rel=1e-9)
    assert (abs(x) <= 1.0) == (a_dt <= 2.0)


def test_symbols_and_numbers_step_alike():
    x, u, p = ca.SX.sym('x', 2), ca.SX.sym('u'), ca.SX.sym('p')

    def symbolic(x, u, p):
        return ca.vertcat(x[1], -p * ca.sin(x[0]) - 0.1 * x[1] + u)

    F = ca.Function('F', [x, u, p], [rk2(symbolic, 0.05)(x, u, p)])
    expected = rk2(pendulum, 0.05)(np.array([0.7, -1.0]), 0.2, 9.81)
    assert np.allclose(F([0.7, -1.0], 0.2, 9.81).full().ravel(), expected, atol=1e-15)


def test_shift_drops_the_first_stage_and_drives_one_more(double_integrator):
    rng = np.random.default_rng(1)
    X, U = rng.standard_normal((16, 2)), rng.standard_normal((15, 1))
    later = shift(Plan(X, U), double_integrator.problem.dynamics, np.array([0.1]))
    assert np.array_equal(later.X[:-1], X[1:])
    assert np.array_equal(later.U, np.vstack([U[1:], U[-1:]]))
    position, speed = X[-1]
    force = U[-1, 0]
    by_hand = [position + 0.2 * speed + 0.02 * force, speed + 0.2 * force]
    assert np.allclose(later.X[-1], by_hand, atol=1e-14)
    assert later.multipliers is None


def test_shift_moves_multipliers_with_their_stages(double_integrator):
    stages = np.arange(15.0)
    given_ones = Multipliers(
        x=np.arange(32.0).reshape(16, 2),
        u=stages[:, None],
        dynamics=np.column_stack([stages, -stages]),
        g=np.zeros((15, 0)),
        h=np.zeros(0),
    )
    plan = Plan(np.zeros((16, 2)), np.zeros((15, 1)), given_ones)
    later = shift(plan, double_integrator.problem.dynamics, np.array([0.1])).multipliers
    assert np.array_equal(later.u[:, 0], [*stages[1:], 14.0])
    assert np.array_equal(later.x[:-1], given_ones.x[1:])
    assert np.array_equal(later.dynamics[:-1], given_ones.dynamics[1:])
    assert [part.shape for part in later] == [part.shape for part in given_ones]


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'name': 'a b'}, "name 'a b' is not an identifier"),
        ({'horizon': 0}, 'a stage, a state and an input are needed'),
        ({'inputs': ()}, 'a stage, a state and an input are needed'),
        ({'states': ('position',)}, r'dynamics takes arguments of sizes .*\(2, 1\)'),
        ({'parameters': ()}, 'dynamics takes arguments of sizes'),
        ({'scale_x': (1.0,)}, 'one positive scale each is needed'),
        ({'scale_u': (0.0,)}, r"one positive scale each is needed for \('force',\)"),
        ({'scale_u': (float('nan'),)}, 'one positive scale each is needed'),
    ],
)
def test_a_problem_that_contradicts_itself_is_refused(change, message, double_integrator):
    with pytest.raises(ProblemError, match=message):
        dataclasses.replace(double_integrator.problem, **change)


def test_a_cost_must_be_one_number(double_integrator):
    x, u, p = ca.SX.sym('x', 2), ca.SX.sym('u'), ca.SX.sym('p')
    with pytest.raises(ProblemError, match='stage_cost must return one vector of 1'):
        dataclasses.replace(double_integrator.problem, stage_cost=ca.Function('l', [x, u, p], [x]))


def test_a_problem_without_constraints_and_terminal_cost_needs_only_its_dynamics_and_cost():
    problem = small_problems.without_parameters()
    assert (problem.ng, problem.nh) == (0, 0)
    assert float(problem.terminal_cost([1.0, 2.0], [])) == 0.0
    assert (problem.scale_x, problem.scale_u) == ((1.0, 1.0), (1.0,))


def test_arrays_are_printed_by_their_shapes(double_integrator):
    problem = double_integrator.problem
    assert repr(zero_plan(problem)) == 'Plan(X: (16, 2), U: (15, 1))'
    bounds = no_bounds(problem)
    assert repr(bounds).startswith('Bounds(x_low: (16, 2), x_high: (16, 2), u_low: (15, 1)')
    multipliers = Multipliers(*(np.zeros(2) for _ in Multipliers._fields))
    assert repr(multipliers).startswith('Multipliers(x: (2,)')
    plan = zero_plan(problem)._replace(multipliers=multipliers)
    assert repr(plan).endswith(', with multipliers)')


def with_double_cost(problem):
    xs, us, ps = problem.stage_cost.mx_in()
    cost = ca.Function('stage_cost', [xs, us, ps], [2 * problem.stage_cost(xs, us, ps)])
    return dataclasses.replace(problem, stage_cost=cost)


def with_longer_horizon(problem):
    return dataclasses.replace(problem, horizon=problem.horizon + 1)


def with_another_scale(problem):
    first, *others = problem.scale_x
    return dataclasses.replace(problem, scale_x=(2 * first, *others))


def with_another_name(problem):
    return dataclasses.replace(problem, name='other')


def copy_of(problem):
    """Return an equal problem with functions of its own."""
    values = {field.name: getattr(problem, field.name) for field in dataclasses.fields(problem)}
    functions = {name: value for name, value in values.items() if isinstance(value, ca.Function)}
    copies = {n: ca.Function.deserialize(f.serialize()) for n, f in functions.items()}
    return dataclasses.replace(problem, **copies)


@pytest.fixture
def make():
    """Return a function that is cached by the content of its problem."""
    return functools.lru_cache(MAX_CACHED_PROBLEMS)(lambda problem, *others: object())


def test_equal_problems_share_cached_results(make, slalom):
    assert make(copy_of(slalom.problem)) is make(slalom.problem)
    assert make(slalom.problem, 1) is not make(slalom.problem, 2)


@pytest.mark.parametrize(
    'change', [with_double_cost, with_longer_horizon, with_another_scale, with_another_name]
)
def test_different_problems_have_results_of_their_own(make, slalom, change):
    assert make(change(slalom.problem)) is not make(slalom.problem)
    assert change(slalom.problem) != slalom.problem


def test_the_results_of_the_last_problems_are_cached(make, slalom):
    first, second, *_ = (make(slalom.problem, number) for number in range(MAX_CACHED_PROBLEMS))
    assert make(slalom.problem, 0) is first  # now the most recent one
    make(slalom.problem, 'one more')
    assert make(slalom.problem, 0) is first
    assert make(slalom.problem, 1) is not second
