"""Trajectory tracking: its reference is fixed in time, whatever the guess does."""

import numpy as np
import pytest

from mpcc_controller.driving.controller import Controller
from mpcc_controller.model.single_track import State
from mpcc_controller.path import reference_path
from mpcc_controller.problem import formulation, stage_parameters
from mpcc_controller.problem.tracking_formulation import TrackingFormulation

N = 50


@pytest.fixture(scope='module')
def tracking(world):
    params, vehicle = world.load('tracking')
    form = formulation.make(params, stage_parameters.car(params, vehicle))
    assert isinstance(form, TrackingFormulation)
    return form


def standing(theta):
    return np.tile(State(theta, 0.4, 0.0, 5.0, 0.0, 0.0, theta, 0.0, 0.0), (N + 1, 1))


def test_the_reference_starts_at_the_car_and_moves_at_the_desired_speed(tracking, world, scene):
    path = reference_path.build(world.straight(v=20.0).reference)
    stages = tracking.stage_parameters(scene._replace(path=path), standing(10.0)).stages
    assert stages.path.theta == pytest.approx(10.0 + 20.0 * 0.05 * np.arange(N + 1))
    assert stages.v_ref == pytest.approx(np.full(N + 1, 20.0))


def test_the_errors_are_relative_to_the_moving_point_for_every_theta(tracking, scene):
    stage = tracking.stage_parameters(scene, standing(10.0)).stages
    later = stage._replace(path=type(stage.path)(*(column[7] for column in stage.path)))
    x = State(10.0, 0.4, 0.1, 5.0, 0.0, 0.0, 10.0, 0.0, 0.0)
    circle = later._replace(obstacles=(), body=later.body._replace(offsets=()))
    for theta in (10.0, 17.0):
        errors = tracking.ocp.quantities(x._replace(theta=theta), None, circle)
        # the lane change begins at 45 m: up to there the path is the x axis
        assert float(errors.tracking.lag) == pytest.approx(later.path.theta - 10.0)
        assert float(errors.tracking.con) == pytest.approx(0.4)
        assert float(errors.heading_error) == pytest.approx(0.1)


def test_it_drives_a_lane_change_past_an_obstacle(world):
    controller = Controller(*world.load('tracking'))
    situation = world.lane_change()
    run = world.drive(world.set_inputs(controller, situation), 110)
    obstacle = situation.obstacles.items[0]
    gap = np.hypot(run.states.X - obstacle.X, run.states.Y - obstacle.Y) - obstacle.r_obs - 1.1
    assert np.min(gap) > 0.2
    assert abs(run.states.Y[-1] - 3.5) < 0.2
    assert {why.values['rung'] for why in run.whys} <= {'solved', 'stopped_early'}
