"""Circles over the outline of the car: they cover it, and no more of them than asked for."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bags.evaluation.vehicle_shape import Outline, circles_of
from mpcc_controller import covering_circles
from mpcc_controller.driving import guesses
from mpcc_controller.driving.controller import Controller
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import CarOutline
from mpcc_controller.path import reference_path, road_edges
from mpcc_controller.problem import formulation, stage_parameters
from mpcc_controller.problem.plan_evaluator import PlanEvaluator
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.types import Obstacle
from node_runtime.parameters import ParameterError

quick = settings(max_examples=60)
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

    def drive(name):
        controller = Controller(*world.load(name, candidates__most=1))
        run = world.drive(world.set_inputs(controller, world.lane_change()), 70)
        obstacle = world.lane_change().obstacles.items[0]
        x, shape = run.states, world.load()[1].outline
        dx, dy = obstacle.X - x.X, obstacle.Y - x.Y
        ahead = np.cos(x.psi) * dx + np.sin(x.psi) * dy
        aside = np.abs(np.cos(x.psi) * dy - np.sin(x.psi) * dx)
        beyond = np.maximum(ahead - shape.front_m, -ahead - shape.rear_m)
        gap = np.hypot(np.maximum(beyond, 0), np.maximum(aside - shape.width_m / 2, 0))
        return gap.min() - obstacle.r_obs, run.whys

    one, _ = drive('mpcc')
    several, whys = drive('mpcc_road')  # its problem is compiled for other tests, too
    assert several > max(one, 0.3)
    values = whys[10].values
    gaps = [values[f'v2o.1.circle_{number}'] for number in (1, 2, 3)]
    assert min(gaps) == values['v2o.1']
    assert {f'v2e.{side}.circle_{k}' for side in ('left', 'right') for k in (1, 3)} <= set(values)


def test_at_edges_half_of_the_width_counts_unless_another_radius_is_given(world):
    params, vehicle = world.load(body__circles=3)
    body = covering_circles.with_covering_circles(params, vehicle).body
    assert body.edge_radius_m == vehicle.outline.width_m / 2 < body.circle_radius_m
    params, _ = world.load(body__circles=3, body__edge_radius_m=1.3)
    assert covering_circles.with_covering_circles(params, vehicle).body.edge_radius_m == 1.3


@pytest.mark.parametrize('controller', ['mpcc', 'frenet'])
def test_the_radius_at_edges_changes_distances_to_edges_only(world, controller):
    """A car that stands beside the path between straight edges 6 m to either side."""
    obstacle = Obstacle(1, 62.0, 1.0, 0.5, 0.0, 0.0)
    situation = world.straight(obstacles=[obstacle])
    scene = Scene(
        reference_path.build(situation.reference),
        road_edges.build(situation.edges),
        situation.obstacles,
    )
    x0 = State(50.0, 0.5, 0.0, 20.0, 0.0, 0.0, 50.0, 0.0, 0.0)

    def first_stage(**changes):
        params, vehicle = world.load(controller, **changes)
        car = stage_parameters.car(params, vehicle)
        form = formulation.make(params, car)
        plan = guesses.from_path(scene.path, x0, car, 5, 0.05)
        numbers = form.stage_parameters(scene, plan.X)
        values = PlanEvaluator(form.ocp).evaluate(form.to_local(plan, scene.path), numbers.P)
        return values.v2o[0][0], [side[0] for side in values.v2e]

    near, own = first_stage()
    also_near, given = first_stage(body__edge_radius_m=0.9)
    assert also_near == pytest.approx(near)
    assert own == pytest.approx([6 - 0.5 - 1.1, 6 + 0.5 - 1.1], abs=1e-3)
    assert given == pytest.approx([6 - 0.5 - 0.9, 6 + 0.5 - 0.9], abs=1e-3)
