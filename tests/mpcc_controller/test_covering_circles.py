"""Circles over the outline of the car: they cover it, and no more of them than asked for."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bags.evaluation.vehicle_shape import Outline, circles_of
from mpcc_controller import covering_circles
from mpcc_controller.driving.controller import Controller
from mpcc_controller.parameters import CarOutline
from node_runtime.parameters import ParameterError

quick = settings(deadline=None, derandomize=True, max_examples=60)
outlines = st.builds(CarOutline, st.floats(0.5, 8), st.floats(0.5, 8), st.floats(0.5, 3))
counts = st.integers(1, 9)


def boundary(outline, points=200):
    """Return points (n, 2) [m, vehicle frame] on the four sides of an outline."""
    u = np.linspace(0, 1, points)
    x = -outline.rear_m + u * (outline.front_m + outline.rear_m)
    y = (u - 0.5) * outline.width_m
    sides = [(x, np.full(points, s * outline.width_m / 2)) for s in (-1, 1)]
    ends = [(np.full(points, end), y) for end in (-outline.rear_m, outline.front_m)]
    return np.concatenate([np.column_stack(side) for side in (*sides, *ends)])


@quick
@given(outlines, counts)
def test_every_point_of_the_outline_is_in_a_circle(outline, count):
    radius, offsets = covering_circles.cover(outline, count)
    centres = np.column_stack([offsets, np.zeros(count)])
    distance = np.linalg.norm(boundary(outline)[:, None] - centres[None], axis=2).min(axis=1)
    assert distance.max() <= radius + 1e-9
    # and no smaller radius covers it: the corners are on circles
    assert distance.max() == pytest.approx(radius, rel=1e-9)


@quick
@given(outlines, counts)
def test_the_circles_are_symmetric_about_the_middle_of_the_outline(outline, count):
    _, offsets = covering_circles.cover(outline, count)
    assert len(offsets) == count
    middle = (outline.front_m - outline.rear_m) / 2
    assert np.add(offsets, offsets[::-1]) / 2 == pytest.approx(np.full(count, middle), abs=1e-9)


@quick
@given(outlines, counts)
def test_the_evaluation_has_the_circles_of_the_controller(outline, count):
    seen = Outline(outline.front_m, outline.rear_m, outline.width_m)
    radius, offsets = circles_of({'body.circles': count}, seen)
    expected_radius, expected = covering_circles.cover(outline, count)
    assert radius == pytest.approx(expected_radius)
    assert offsets == pytest.approx(expected)


def test_without_the_parameter_the_circles_are_those_of_the_file(world):
    params, vehicle = world.load()
    assert covering_circles.with_covering_circles(params, vehicle) is params


def test_a_car_file_without_an_outline_is_named(world):
    params, vehicle = world.load(body__circles=3)
    bare = dataclasses.replace(vehicle, outline=CarOutline(None, None, None))
    with pytest.raises(ParameterError, match=r'car\.yaml does not have outline\.front_m'):
        covering_circles.with_covering_circles(params, bare)


def test_with_circles_over_the_outline_the_nose_stays_off_an_obstacle(world):
    """With one circle a bonnet longer than its radius may reach into what the circle avoids."""

    def drive(**changes):
        controller = Controller(*world.load(**changes))
        run = world.drive(world.set_inputs(controller, world.lane_change()), 70)
        obstacle = world.lane_change().obstacles.items[0]
        x, shape = run.states, world.load()[1].outline
        dx, dy = obstacle.X - x.X, obstacle.Y - x.Y
        ahead = np.cos(x.psi) * dx + np.sin(x.psi) * dy
        aside = np.abs(np.cos(x.psi) * dy - np.sin(x.psi) * dx)
        beyond = np.maximum(ahead - shape.front_m, -ahead - shape.rear_m)
        gap = np.hypot(np.maximum(beyond, 0), np.maximum(aside - shape.width_m / 2, 0))
        return gap.min() - obstacle.r_obs, run.whys

    one, _ = drive()
    several, whys = drive(body__circles=3)
    assert several > max(one, 0.3)
    values = whys[10].values
    gaps = [values[f'v2o.1.circle_{number}'] for number in (1, 2, 3)]
    assert min(gaps) == values['v2o.1']
    assert {f'v2e.{side}.circle_{k}' for side in ('left', 'right') for k in (1, 3)} <= set(values)
