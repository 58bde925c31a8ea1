"""First guesses of the plan."""

import numpy as np
import pytest

from mpcc_controller.driving import guesses
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import State
from mpcc_controller.path import reference_path
from stage_solver.stage_problem import Plan


def test_theta_of_a_shifted_plan_starts_at_the_new_foot(car):
    X = np.tile(State(0, 0, 0, 20.0, 0, 0, 0, 0, 0), (5, 1)).astype(float)
    X[:, 0] = X[:, 6] = np.arange(5.0)
    foot = State(1.1, 0.2, 0.0, 19.9, 0.0, 0.0, 1.4, 0.01, -10.0)
    moved = guesses.shift_to(Plan(X, np.zeros((4, 4))), single_track.step(0.05), car, foot)
    states = State(*moved.X.T)
    assert tuple(moved.X[0]) == foot
    assert states.theta == pytest.approx([1.4, 2.4, 3.4, 4.4, 5.4], abs=1e-2)
    assert states.X[1:4] == pytest.approx([2, 3, 4])


def test_without_a_plan_the_guess_blends_from_the_car_to_the_path(world, car):
    path = reference_path.build(world.lane_change().reference)
    x0 = State(20.0, 1.0, 0.1, 20.0, 0.5, 0.1, 20.0, 0.0, 0.0)
    guess = guesses.from_path(path, x0, car, 50, 0.05)
    states = State(*guess.X.T)
    assert tuple(guess.X[0]) == x0
    assert states.Y[1] == pytest.approx(1.0 * 49 / 50, abs=1e-6)
    assert states.Y[-1] == pytest.approx(
        float(reference_path.arcs_at(path, states.theta[-1:])[0].Y[0])
    )
    assert np.all(np.diff(states.theta) == pytest.approx(1.0))
