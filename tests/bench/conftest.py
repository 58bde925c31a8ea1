"""The benchmark's modules, and small problems for them: nothing here needs a compiler."""

from dataclasses import replace

import casadi as ca
import closed_loops
import numpy as np
import problems
import pytest
from closed_loops import Loop

from mpcc_controller.problem import mpcc_formulation, ocp
from stage_solver.stage_problem import Bounds, StageProblem

HORIZON = 10
LOOPS = (
    Loop('swerve', 'double_lane_change', 'mpcc', None, range(55, 62)),
    Loop('pop-up', 'pop_up.yaml', 'mpcc', None, range(17, 24)),
)


def small(name):
    """Return a controller with a short horizon."""
    params = closed_loops.controller_params(name)
    model = replace(params.model, horizon=HORIZON)
    return replace(params, model=model)


@pytest.fixture(scope='session', name='small')
def small_params():
    return small


@pytest.fixture(scope='session')
def driven_loops():
    return LOOPS


@pytest.fixture(scope='session')
def params():
    return small('mpcc')


@pytest.fixture(scope='session')
def problem(params):
    return ocp.build(
        mpcc_formulation.symbolic_ocp(1, params.surroundings.max_obstacles),
        HORIZON,
        params.model.step_s,
    )


@pytest.fixture(scope='session')
def recorded():
    return problems.record(LOOPS, small)


def two_wells():
    """A point that may be pushed into one of two wells, at x = -1 and, a little deeper, x = 1."""
    x, u, p = ca.SX.sym('x'), ca.SX.sym('u'), ca.SX.sym('p')
    well = p * (x**2 - 1) ** 2 + 1 - 0.1 * x
    return StageProblem(
        name='two_wells',
        states=('x',),
        inputs=('u',),
        parameters=('depth',),
        horizon=4,
        dynamics=ca.Function('dynamics', [x, u, p], [x + u]),
        stage_cost=ca.Function('stage_cost', [x, u, p], [0.01 * u**2]),
        terminal_cost=ca.Function('terminal_cost', [x, p], [well]),
        constraints=ca.Function('constraints', [x, u, p], [u - x]),
        terminal_constraints=ca.Function('terminal_constraints', [x, p], [x]),
        scale_x=(1.0,),
        scale_u=(2.0,),
    )


@pytest.fixture(scope='session')
def wells():
    return two_wells()


@pytest.fixture
def limits():
    wide = np.full((4, 1), 3.0)
    return Bounds(
        x_low=np.full((5, 1), -2.0),
        x_high=np.full((5, 1), 2.0),
        u_low=-wide,
        u_high=wide,
        g_low=-2 * wide,
        g_high=2 * wide,
        h_low=np.array([-2.0]),
        h_high=np.array([2.0]),
    )
