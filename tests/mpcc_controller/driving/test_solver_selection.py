"""Which solver runs first, and which after a failure."""

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
def solver_names(params, problem):
    """Return a function that makes both solvers and returns their names."""

    def make_both(name, fallback):
        rules = replace(params.solver, name=name, fallback=fallback, compiled=False)
        changed = replace(params, solver=rules)
        first = make_solver(problem, solver_selection.first_solver_options(changed, TIMELESS))
        second = solver_selection.make_second_solver(changed, problem, TIMELESS, first)
        return first.name, second and second.name

    return make_both


@pytest.mark.parametrize(
    ('name', 'fallback', 'second'),
    [
        ('riccati', 'fatrop', 'fatrop'),
        ('riccati', 'none', None),
        ('fatrop', 'fatrop', None),
        ('fatrop', 'ipopt', 'ipopt'),
    ],
)
def test_the_second_solver_differs_from_the_first(solver_names, name, fallback, second):
    assert solver_names(name, fallback) == (name, second)
