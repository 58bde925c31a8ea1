"""Solved problems of the car: plans like those of fatrop, warm while it drives, to the point."""

import numpy as np
import pytest

from mpcc_controller.driving import guesses
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import State
from mpcc_controller.problem.obstacle_motion import PredictedObstacle
from msgs_yaml.types import Obstacles
from stage_solver.solution import SOLVED
from stage_solver.stage_problem import shift

DT = 0.05
START = State(0.0, 0.0, 0.0, 20.0, 0.0, 0.0, 0.0, 0.0, 0.0)
BESIDE = State(40.0, 0.0, 0.0, 20.0, 0.0, 0.0, 40.0, 0.0, 0.0)
IN_THE_WAY = PredictedObstacle(0, X=40.0, Y=1.9, r_obs=1.0, vX=0.0, vY=0.0)


@pytest.fixture(scope='module')
def road(roads):
    return roads['straight']._replace(obstacles=Obstacles(0, (IN_THE_WAY,)))


@pytest.mark.parametrize('name', ['mpcc', 'frenet'])
def test_a_cold_start_finds_the_plan_of_fatrop(pose, road, name):
    posed = pose(START, name, road, drives=True)
    solution, reference = posed.solve(), posed.solve('fatrop')
    assert solution.status == reference.status == SOLVED
    assert solution.cost == pytest.approx(reference.cost, rel=1e-5)
    assert np.allclose(solution.plan.X, reference.plan.X, rtol=1e-4, atol=1e-2)


def test_a_drive_past_an_obstacle_stays_warm_and_as_cheap_as_fatrop(pose, road):
    posed = pose(START, scene=road, drives=True)
    solution, motion, car = posed.solve(), single_track.step(DT), posed.form.car
    for _ in range(12):
        x0 = State(*solution.plan.X[1])
        guess = guesses.start_at(shift(solution.plan, motion, np.array(car)), x0)
        posed = pose(x0, scene=road, guess=guess)
        solution = posed.solve()
        assert solution.status == SOLVED
        assert solution.iterations <= 10
        assert solution.primal_residual < 1e-5
    assert solution.cost == pytest.approx(posed.solve('fatrop').cost, rel=1e-4)


def planned(pose, x, name='mpcc', **changes):
    """Return the planned states of a lane change, each (N + 1,), and the car."""
    posed = pose(x, name, drives=True, **changes)
    solution = posed.solve()
    assert solution.status == SOLVED
    return State(*solution.plan.X.T), posed.form.car


def test_a_soft_limit_keeps_the_rear_axle_below_it(pose):
    def peak_slip(**changes):
        x, car = planned(pose, BESIDE, **changes)
        return np.abs(np.arctan2(x.vy - car.l_r * x.r, x.vx)).max(), car

    paper, car = peak_slip()
    limit = 0.25 * float(single_track.sliding_slips(car).r)
    limited, _ = peak_slip(tolerances__rear_slip_excess_rad=0.01, envelope__rear_slip=0.25)
    assert limited < limit + 0.01 < paper


def test_the_lateral_jerk_term_makes_a_lane_change_smoother(pose):
    def peak_jerk(**changes):
        x, _ = planned(pose, BESIDE, **changes)
        return np.abs(np.diff(x.r * x.vx)).max() / DT

    assert peak_jerk(tolerances__lateral_jerk_mps3=5.0) < 0.8 * peak_jerk()


def test_tracking_changes_the_lane_past_the_obstacle(pose, scene):
    x, _ = planned(pose, BESIDE, 'tracking')
    (obstacle,) = scene.obstacles.items
    assert np.min(np.hypot(x.X - obstacle.X, x.Y - obstacle.Y)) - obstacle.r_obs - 1.1 > 0.2
    assert abs(x.Y[-1] - 3.5) < 0.3
