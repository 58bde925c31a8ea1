"""Invalid values and shapes are refused by name."""

import numpy as np
import pytest
from small_problems import each_solver

from stage_solver.solution import FAILED
from stage_solver.stage_problem import Plan, ProblemError


@each_solver
@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (lambda c: c._replace(x0=c.x0 * np.nan), 'initial state is not finite: X = nan'),
        (lambda c: c._replace(P=with_nan(c.P, (4, 2))), 'parameters is not finite: r_disc = nan'),
        (
            lambda c: c._replace(guess=Plan(with_nan(c.guess.X, (7, 1)), c.guess.U)),
            'guess .*: Y = ',
        ),
        (
            lambda c: c._replace(guess=Plan(c.guess.X, with_nan(c.guess.U, (2, 0)))),
            'guess .*: push',
        ),
        (lambda c: crossed(c, 5, 3.0), r'no value of u\[5, 0\] lies in \[3.0, 2.0\]'),
        (lambda c: crossed(c, 5, np.nan), r'no value of u\[5, 0\] lies in \[nan, 2.0\]'),
    ],
    ids=['x0', 'P', 'guess of states', 'guess of inputs', 'crossed limits', 'limit not a number'],
)
def test_invalid_values_are_refused_by_name(name, change, message, slalom, solver):
    case = change(slalom)
    solution = solver(name, case.problem).solve(*case.numbers)
    assert solution.status == FAILED
    assert solution.iterations == 0
    assert not np.isfinite(solution.primal_residual)
    with pytest.raises(AssertionError, match=message):
        raise AssertionError(solution.message)


def with_nan(array, at):
    array = array.copy()
    array[at] = np.nan
    return array


def crossed(case, stage, low):
    u_low = case.bounds.u_low.copy()
    u_low[stage, 0] = low
    return case._replace(bounds=case.bounds._replace(u_low=u_low))


@each_solver
def test_a_wrong_shape_raises_with_its_name(name, slalom, solver):
    own = solver(name, slalom.problem)
    with pytest.raises(ProblemError, match=r'P has shape \(30, 4\); \(31, 4\) is needed'):
        own.solve(slalom.x0, slalom.P[:-1], slalom.bounds, slalom.guess)
