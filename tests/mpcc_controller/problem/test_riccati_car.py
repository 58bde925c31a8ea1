"""The Riccati solver on the MPCC: cold, warm, disturbed, and with an obstacle that appears."""

import numpy as np
import pytest

from mpcc_controller.driving import guesses
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import State
from mpcc_controller.path import reference_path, road_edges
from mpcc_controller.problem import bounds, formulation, ocp, stage_parameters
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.types import Obstacle, Obstacles, Reference, RoadEdges
from stage_solver.reference_solvers import ReferenceSolver
from stage_solver.solution import SOLVED, SolverOptions
from stage_solver.solver import make_solver
from stage_solver.stage_problem import Plan

SPEED = 20.0
IN_THE_WAY = Obstacle(0, X=40.0, Y=1.9, r_obs=1.0, vX=0.0, vY=0.0)
POPS_UP = Obstacle(1, X=48.0, Y=-1.6, r_obs=0.8, vX=0.0, vY=0.0)
X_START = State(X=0.0, Y=0.0, psi=0.0, vx=SPEED, vy=0.0, r=0.0, theta=0.0, delta=0.0, Fx=0.0)
NOISE = State(X=0.1, Y=0.1, psi=0.02, vx=0.5, vy=0.1, r=0.05, theta=0.0, delta=0.01, Fx=300.0)


class Drive:
    """The plan's numbers at any state, and the problem they belong to."""

    def __init__(self, params, vehicle):
        self.params = params
        self.car = stage_parameters.car(self.params, vehicle)
        model = self.params.model
        self.formulation = formulation.make(self.params, self.car)
        self.problem = ocp.build(self.formulation.ocp, model.horizon, model.step_s)
        self.motion = single_track.step(model.step_s)
        X = np.arange(0.0, 200.0, 1.0)
        path = reference_path.build(Reference(0, X, 0 * X, 0 * X, X / SPEED))
        edges = RoadEdges(0, *(np.array([[-50.0, y], [250.0, y]]) for y in (4.0, -4.0)))
        self.scene = Scene(path, road_edges.build(edges), Obstacles(0, (IN_THE_WAY,)))

    def numbers(self, x0, plan=None, obstacles=(IN_THE_WAY,)):
        model = self.params.model
        scene = self.scene._replace(obstacles=Obstacles(0, obstacles))
        if plan is None:
            plan = guesses.from_path(scene.path, x0, self.car, model.horizon, model.step_s)
        plan = guesses.start_at(plan, x0)
        P = self.formulation.stage_parameters(scene, plan.X).P
        limits = bounds.build(self.params.limits, self.car, x0.Fx, model.horizon, model.step_s)
        return np.array(x0), P, limits, plan

    def shifted(self, plan):
        return guesses.shift_to(plan, self.motion, self.car, State(*plan.X[1]))


@pytest.fixture(scope='module')
def drive(world):
    return Drive(*world.load())


@pytest.fixture(scope='module')
def fatrop(drive):
    return ReferenceSolver(drive.problem, 'fatrop', SolverOptions(200, 1e-8))


@pytest.fixture(scope='module')
def riccati(drive):
    return make_solver(drive.problem, SolverOptions(200, 1e-6))


def test_a_cold_start_reaches_the_same_cost_as_fatrop(drive, riccati, fatrop):
    numbers = drive.numbers(X_START)
    solution, reference = riccati.solve(*numbers), fatrop.solve(*numbers)
    assert solution.status == reference.status == SOLVED
    assert solution.cost == pytest.approx(reference.cost, rel=1e-6)
    assert np.allclose(solution.plan.X, reference.plan.X, rtol=1e-4, atol=1e-3)


def test_drive_past_an_obstacle_stays_warm_and_as_cheap_as_fatrop(drive, riccati, fatrop):
    solution = riccati.solve(*drive.numbers(X_START))
    for _ in range(12):
        plan = drive.shifted(solution.plan)
        numbers = drive.numbers(State(*plan.X[0]), plan)
        solution, reference = riccati.solve(*numbers), fatrop.solve(*numbers)
        assert solution.status == SOLVED
        assert solution.iterations <= 10
        assert solution.primal_residual < 1e-5
        assert solution.cost == pytest.approx(reference.cost, rel=1e-4)


def test_disturbed_states_are_solved_from_the_old_plan(drive, riccati):
    rng = np.random.default_rng(12)
    plan = riccati.solve(*drive.numbers(X_START)).plan
    for _ in range(20):
        x0 = State(*(np.array(X_START) + rng.standard_normal(9) * NOISE))
        solution = riccati.solve(*drive.numbers(x0, plan))
        assert solution.status == SOLVED
        assert solution.primal_residual < 1e-5


def test_an_obstacle_that_appears_is_avoided_at_once(drive, riccati):
    before = riccati.solve(*drive.numbers(X_START))
    after = riccati.solve(*drive.numbers(X_START, before.plan, (IN_THE_WAY, POPS_UP)))
    assert after.status == SOLVED
    gaps = []
    for plan in (before.plan, after.plan):
        away = np.hypot(plan.X[:, 0] - POPS_UP.X, plan.X[:, 1] - POPS_UP.Y)
        gaps.append(away.min())
    assert gaps[1] > gaps[0]


def test_guess_without_inputs_and_far_from_the_dynamics_is_good_enough(drive, riccati, fatrop):
    x0, P, limits, plan = drive.numbers(X_START)
    X = plan.X.copy()
    X[1:, State._fields.index('vx')] += 3.0
    X[1:, State._fields.index('Y')] += 1.0
    bent = Plan(X, 0 * plan.U)
    solution, reference = riccati.solve(x0, P, limits, bent), fatrop.solve(x0, P, limits, bent)
    assert solution.status == SOLVED
    assert solution.cost <= reference.cost * (1 + 1e-4)
