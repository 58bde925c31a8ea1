"""The midpoint rule, the shift of a plan, equal and contradictory problems."""

import dataclasses

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_problems import double_integrator, slalom

from stage_solver import Multipliers, Plan, ProblemError, no_bounds, rk2, shift, zero_plan
from stage_solver.riccati_codegen import source

PROBLEM = slalom().problem


@given(st.floats(0.05, 3.0), st.floats(-2.0, 2.0))
def test_a_step_is_the_midpoint_rule_on_numbers_and_symbols(dt, x):
    def decay(x, u, p):
        return -p * x**2 + u

    midpoint = x + dt / 2 * (-3.0 * x**2 + 0.4)
    by_hand = x + dt * (-3.0 * midpoint**2 + 0.4)
    assert rk2(decay, dt)(x, 0.4, 3.0) == pytest.approx(by_hand, rel=1e-12, abs=1e-12)
    symbols = [ca.SX.sym(name) for name in 'xup']
    step = ca.Function('F', symbols, [rk2(decay, dt)(*symbols)])
    assert float(step(x, 0.4, 3.0)) == pytest.approx(by_hand, rel=1e-12, abs=1e-12)


def test_a_shifted_plan_drops_its_first_stage_and_drives_one_more():
    rng = np.random.default_rng(1)
    shapes = PROBLEM.shapes
    X, U = rng.standard_normal(shapes['X']), rng.standard_normal(shapes['U'])
    parts = {name: rng.standard_normal(shapes[f'm_{name}']) for name in Multipliers._fields}
    p = slalom().P[-1]
    later = shift(Plan(X, U, Multipliers(**parts)), PROBLEM.dynamics, p)
    assert np.array_equal(later.X[:-1], X[1:])
    assert later.X[-1] == pytest.approx(PROBLEM.dynamics(X[-1], U[-1], p).full().ravel())
    assert np.array_equal(later.U, np.vstack([U[1:], U[-1:]]))
    for name, rows in parts.items():
        expected = rows if name == 'h' else np.vstack([rows[1:], rows[-1:]])
        assert np.array_equal(getattr(later.multipliers, name), expected), name
    assert shift(Plan(X, U), PROBLEM.dynamics, p).multipliers is None


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'name': 'a b'}, "name 'a b' is not an identifier"),
        ({'horizon': 0}, 'a stage, a state and an input are needed'),
        ({'inputs': ()}, 'a stage, a state and an input are needed'),
        ({'states': ('X',)}, r'slalom: dynamics takes arguments of sizes .*\(4, 1\).*\(1, 1\)'),
        ({'parameters': ()}, 'dynamics takes arguments of sizes'),
        ({'scale_x': (1.0,)}, 'one positive scale each is needed'),
        ({'scale_u': (0.0, 1.0)}, r"one positive scale each is needed for \('push', 'turn'\)"),
        ({'scale_u': (float('nan'), 1.0)}, 'one positive scale each is needed'),
        ({'stage_cost': PROBLEM.dynamics}, 'stage_cost must return one vector of 1'),
        ({'terminal_cost': PROBLEM.stage_cost}, 'terminal_cost takes arguments of sizes'),
    ],
)
def test_a_problem_that_contradicts_itself_is_refused(change, message):
    with pytest.raises(ProblemError, match=message):
        dataclasses.replace(PROBLEM, **change)


def test_a_problem_needs_only_its_dynamics_and_cost():
    case = double_integrator(lambda x: 0)
    problem = case.problem
    assert (problem.ng, problem.nh) == (0, 0)
    assert (problem.scale_x, problem.scale_u) == ((1.0, 1.0), (1.0,))
    assert float(problem.terminal_cost([1.0, 2.0], [])) == 0.0
    assert case.solve().status == 'solved'


def test_a_vector_may_be_a_row():
    x, u, p = (ca.SX.sym(*size) for size in (('x', 4), ('u', 2), ('p', 4)))
    rows = {
        name: ca.Function(name, [x, u, p], [getattr(PROBLEM, name)(x, u, p).T])
        for name in ('dynamics', 'constraints')
    }
    assert source(dataclasses.replace(PROBLEM, **rows)) == source(PROBLEM)


def test_arrays_are_printed_by_their_shapes():
    assert repr(zero_plan(PROBLEM)) == 'Plan(X: (31, 4), U: (30, 2))'
    start = 'Bounds(x_low: (31, 4), x_high: (31, 4), u_low: (30, 2)'
    assert repr(no_bounds(PROBLEM)).startswith(start)
    multipliers = Multipliers(*(np.zeros(2) for _ in Multipliers._fields))
    assert repr(multipliers).startswith('Multipliers(x: (2,)')
    plan = zero_plan(PROBLEM)._replace(multipliers=multipliers)
    assert repr(plan).endswith(', with multipliers)')


def test_problems_are_equal_where_their_content_is():
    values = {field.name: getattr(PROBLEM, field.name) for field in dataclasses.fields(PROBLEM)}
    copies = {
        name: ca.Function.deserialize(value.serialize())
        for name, value in values.items()
        if isinstance(value, ca.Function)
    }
    copy = dataclasses.replace(PROBLEM, **copies)
    assert copy == PROBLEM
    assert hash(copy) == hash(PROBLEM)
    symbols = PROBLEM.stage_cost.mx_in()
    doubled = ca.Function('l', symbols, [2 * PROBLEM.stage_cost(*symbols)])
    for change in (
        {'stage_cost': doubled},
        {'horizon': PROBLEM.horizon + 1},
        {'scale_x': (20.0, *PROBLEM.scale_x[1:])},
        {'name': 'other'},
    ):
        assert dataclasses.replace(PROBLEM, **change) != PROBLEM, change
    assert PROBLEM != 'slalom'
