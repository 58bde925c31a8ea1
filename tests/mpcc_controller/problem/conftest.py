"""Optimal control problems posed at states of the map."""

from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pytest

from mpcc_controller.driving import guesses
from mpcc_controller.model.single_track import Input, State
from mpcc_controller.problem import bounds, formulation, ocp, stage_parameters
from mpcc_controller.problem.ocp import PlanEvaluator
from mpcc_controller.problem.stage_parameters import StageParameters
from node_runtime import named_vector
from stage_solver.reference_solvers import ReferenceSolver
from stage_solver.solution import SolverOptions
from stage_solver.solver import make_solver
from stage_solver.stage_problem import Plan

N, DT = 50, 0.05
AT_REST = Input(0.0, 0.0, 0.5, 0.0)


class Posed(NamedTuple):
    """A formulation, and a plan in its states with the parameters of the stages around it."""

    form: Any
    plan: Plan
    numbers: StageParameters

    def problem(self):
        return ocp.build(self.form.ocp, N, DT)

    def values(self, plan=None):
        return PlanEvaluator(self.form.ocp).evaluate(plan or self.plan, self.numbers.P)

    def column(self, name):
        """Return a parameter of every stage (N + 1,) by its name."""
        return self.numbers.P[:, self.problem().parameters.index(name)]

    def errors(self, u=AT_REST, x=None, **stage):
        """Return the squared errors of stage 0 by name, those of `x` if it is given.

        Without an input they are those of the last stage; `stage` are other parameters.
        """
        errors = self.form.ocp.errors(*self._arguments(u, x, stage))
        return {name: float(error) for name, error in errors.items()}

    def constraints(self, u=AT_REST):
        return self.form.ocp.constraints(*self._arguments(u, None, {}))

    def solve(self, name='riccati'):
        """Return the solution from this guess; the plan is in the states of the formulation."""
        params, ocp_ = self.form.params, self.form.ocp
        start = ocp_.state(*self.plan.X[0])
        circles = len(params.body.circle_offsets_m)
        limits = bounds.build(params.limits, self.form.car, start, N, DT, ocp_.state, circles)
        options = SolverOptions(max_iterations=200, tolerance=1e-6 if name == 'riccati' else 1e-8)
        make = make_solver if name == 'riccati' else partial(ReferenceSolver, name=name)
        solver = make(self.problem(), options=options)
        return solver.solve(self.plan.X[0], self.numbers.P, limits, self.plan)

    def _arguments(self, u, x, changes):
        stage = named_vector.build(self.numbers.stages, self.numbers.P[0])
        return x or self.form.ocp.state(*self.plan.X[0]), u, stage._replace(**changes)


@pytest.fixture(scope='session')
def roads(world):
    """Return a lane change past an obstacle, and a straight road with the same obstacle."""
    change = world.lane_change()
    straight = world.straight(obstacles=change.obstacles.items)
    return {'lane change': world.scene(change), 'straight': world.scene(straight)}


@pytest.fixture(scope='session')
def scene(roads):
    return roads['lane change']


@pytest.fixture(scope='session')
def pose(world, scene):
    """Return pose(x, controller, ...) -> Posed.

    The plan stays at the state x, or `drives` from it along the path.
    Changes are those of `world.load`; `params` replace all parameters.
    """

    def make(x, name='mpcc', scene=scene, drives=False, params=None, **changes):
        loaded, vehicle = world.load(name, **changes)
        params = params or loaded
        form = formulation.make(params, stage_parameters.car(params, vehicle))
        plan = Plan(np.tile(x, (N + 1, 1)), np.tile(AT_REST, (N, 1)))
        if drives:
            plan = guesses.from_path(scene.path, x, form.car, N, DT)
        plan = guesses.start_at(plan, x)
        numbers = form.stage_parameters(scene, plan.X)
        return Posed(form, form.to_local(plan, scene.path), numbers)

    return make


@pytest.fixture
def still():
    """Return still(**values): a state of a car that drives at 20 m/s and is zero elsewhere."""
    zeros = State(*[0.0] * len(State._fields))._replace(vx=20.0)
    return lambda **values: zeros._replace(**values)
