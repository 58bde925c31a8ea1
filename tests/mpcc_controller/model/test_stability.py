"""Every car is predicted in stable steps, whatever its tyres."""

import dataclasses

import numpy as np
import pytest

from mpcc_controller.driving.prediction_model import PredictionModel
from mpcc_controller.in_force import describe_changes
from mpcc_controller.model import stability
from mpcc_controller.model.single_track import Input, State
from node_runtime.parameters import ParameterError

STEPS = 40


def growth_of_the_textbook(car, vx, slip_speed, dt=0.05):
    """Return the growth of the linear single track per midpoint step, slips at `slip_speed`."""
    C, arm = np.array([car.C_f, car.C_r]), np.array([car.l_f, -car.l_r])
    damping = np.array([[C.sum(), C @ arm], [C @ arm, C @ arm**2]]) / slip_speed
    a = -dt * (damping / [[car.m], [car.Izz]] + [[0.0, vx], [0.0, 0.0]])
    return np.max(np.abs(np.linalg.eigvals(np.eye(2) + a + a @ a / 2)))


@pytest.mark.parametrize('vx', [10.0, 20.0, 30.0])
def test_the_lateral_motion_is_that_of_the_textbooks_linear_single_track(car, vx):
    expected = growth_of_the_textbook(car, vx, vx)
    assert stability.growth(car, 0.05, vx) == pytest.approx(expected, rel=1e-3)


def with_tyres(vehicle, factor):
    """Return a car whose tyres are so many times as stiff."""
    tyre = dataclasses.replace(
        vehicle.tyre,
        front_cornering_npr=factor * vehicle.tyre.front_cornering_npr,
        rear_cornering_npr=factor * vehicle.tyre.rear_cornering_npr,
    )
    return dataclasses.replace(vehicle, tyre=tyre)


def swing_after(prediction, vx):
    """Return how much of a small lateral motion is left after 2 s of prediction."""
    x = np.array(State(0, 0, 0, vx, 0.02, 0.0, 0, 0, 0.0))
    for _ in range(STEPS):
        x = prediction.step(x, np.array(Input(0.0, 0.0, 0.5, 0.0)), prediction.car)
        x[3] = vx  # the resistances slow it down
    return np.hypot(x[4], x[5]) / 0.02


@pytest.mark.parametrize(
    ('low_speed', 'factor'),
    [(None, 0.5), (None, 1.0), (None, 3.0), (True, 1.0), (True, 3.0)],
)
def test_wherever_the_car_drives_its_prediction_calms_down(world, low_speed, factor):
    params, vehicle = world.load(limits__least_speed_mps=3.0, model__low_speed=low_speed)
    vehicle = with_tyres(vehicle, factor)
    model = PredictionModel(params, vehicle)
    least = model.params.limits.least_speed_mps
    for vx in np.arange(least or 0.5, 30.0, 2.0):
        assert swing_after(model, vx) < 1.0, vx
    told = ' '.join(describe_changes(params, vehicle))
    if low_speed:  # it is kinematic where it has to be
        assert bool(told) == (factor > 1)
    else:
        assert (f'is {least:g} instead of 3' in told) == (least > 3.0)
        faster = PredictionModel(*world.load(limits__least_speed_mps=40.0))
        assert faster.params.limits.least_speed_mps == 40.0


@pytest.mark.parametrize('low_speed', [False, True])
def test_a_car_that_no_step_can_follow_is_refused(world, low_speed):
    params, vehicle = world.load(model__step_s=0.2, model__low_speed=low_speed)
    with pytest.raises(ParameterError, match=r'model.step_s: is 0.2.*allowed shorter steps'):
        PredictionModel(params, with_tyres(vehicle, 4.0))
