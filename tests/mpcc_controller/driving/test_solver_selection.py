"""Which solver is asked first, and which after a failure."""

from dataclasses import replace

import pytest

from mpcc_controller.driving import solver_selection
from mpcc_controller.problem import formulation, ocp, stage_parameters
from stage_solver.solver import make_solver

TIMELESS = False  # no limit of wall time


@pytest.fixture(scope='module')
def problem(params, vehicle):
    symbolic = formulation.make(params, stage_parameters.car(params, vehicle)).ocp
    return ocp.build(symbolic, params.model.horizon, params.model.step_s)


@pytest.fixture
def made(params, problem):
    """Return a function that makes both solvers and returns their names."""

    def names(name, fallback):
        rules = replace(params.solver, name=name, fallback=fallback, compiled=False)
        told = replace(params, solver=rules)
        first = make_solver(problem, solver_selection.first_solver_options(told, TIMELESS))
        second = solver_selection.make_second_solver(told, problem, TIMELESS, first)
        return first.name, second and second.name

    return names


@pytest.mark.parametrize(
    ('name', 'fallback', 'second'),
    [
        ('riccati', 'fatrop', 'fatrop'),
        ('riccati', 'none', None),
        ('fatrop', 'fatrop', None),
        ('fatrop', 'ipopt', 'ipopt'),
    ],
)
def test_second_solver_is_another_one(made, name, fallback, second):
    assert made(name, fallback) == (name, second)


def test_without_a_compiler_the_substitute_is_not_asked_twice(made, monkeypatch):
    monkeypatch.setenv('CC', 'no-such-compiler')
    assert made('riccati', 'fatrop') == ('fatrop', None)
    assert made('riccati', 'ipopt') == ('fatrop', 'ipopt')
