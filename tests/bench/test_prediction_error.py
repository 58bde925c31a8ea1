"""The benchmark of the prediction error: what it predicts again, and what it counts."""

import numpy as np
import prediction_error
import pytest
from prediction_error import Windows

from experiments import simulation
from mpcc_controller.model import single_track
from mpcc_controller.problem import stage_parameters


@pytest.fixture(scope='module')
def setup():
    return simulation.prepare('double_lane_change', 'mpcc')


def of_the_model(setup, ticks):
    """Return windows that the model itself drives."""
    car = stage_parameters.car(setup.params, setup.vehicle)
    step = single_track.step(setup.params.model.step_s)
    rng = np.random.default_rng(7)
    U = rng.normal((0, 0, 0.6, 0), (0.2, 1e4, 0.0, 0.0), (3, ticks, 4))
    X = np.zeros((3, ticks + 1, 9))
    X[:, 0] = (0, 0, 0, 20, 0.1, 0.05, 0, 0.01, 0)
    for k in range(ticks):
        for row, (x, u) in enumerate(zip(X[:, k], U[:, k])):
            X[row, k + 1] = step(x, u, list(car)).full().ravel()
    return Windows(X, U)


def test_a_car_that_is_the_model_is_where_the_model_says(setup):
    given = of_the_model(setup, 6)
    for rms in prediction_error.errors(given, setup, setup.params):
        assert rms == pytest.approx(np.zeros(6), abs=1e-9)
    lagging = prediction_error.with_model(setup.params, servo_lag=True)
    assert prediction_error.errors(given, setup, lagging).yaw_rate[-1] > 1e-3


def test_an_error_is_the_difference_to_the_recorded_state(setup):
    given = of_the_model(setup, 4)
    shifted = given.states.copy()
    shifted[:, 3] += (0.3, 0.4, 0.05, 0.2, 0.1, 0.03, 0, 0, 0)
    found = prediction_error.errors(Windows(shifted, given.inputs), setup, setup.params)
    assert [column[2] for column in found] == pytest.approx([0.5, 0.05, 0.2, 0.1, 0.03])


def test_the_windows_at_the_limit_of_a_drive_are_predicted_better_with_the_lag(setup):
    plant = simulation.prepare('double_lane_change', 'mpcc', speed_mps=18.0)
    short = plant.scn._replace(stop=plant.scn.stop._replace(X=90.0))
    given = prediction_error.windows(plant._replace(scn=short), 10)
    assert given.states.shape[1:] == (11, 9)
    assert np.abs(given.states[:, :, 5] * given.states[:, :, 3]).max(axis=1).min() > 6.5
    plain, lagging = (
        prediction_error.errors(
            given, plant, prediction_error.with_model(plant.params, servo_lag=on)
        )
        for on in (None, True)
    )
    assert lagging.position[-1] < 0.5 * plain.position[-1]
    assert lagging.heading[-1] < 0.7 * plain.heading[-1]
