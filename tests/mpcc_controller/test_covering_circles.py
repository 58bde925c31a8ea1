"""Circles over the outline of the car: they cover it, and no more of them than asked for."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bags.evaluation.drive import Outline, circles_of
from mpcc_controller import in_force
from mpcc_controller.driving import guesses
from mpcc_controller.driving.controller import Controller
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import CarOutline
from mpcc_controller.problem import formulation, stage_parameters
from mpcc_controller.problem.ocp import PlanEvaluator
from msgs_yaml.types import Obstacle
from node_runtime.parameters import ParameterError

outlines = st.builds(CarOutline, st.floats(0.5, 8), st.floats(0.5, 8), st.floats(0.5, 3))


@settings(max_examples=60)
@given(outlines, st.integers(1, 9))
def test_every_point_of_the_outline_is_in_a_circle_as_small_as_can_be(outline, count):
    radius, offsets = in_force.cover(outline, count)
    # the corners of the shares of the length are on circles, and farthest from the centres
    ends = np.linspace(-outline.rear_m, outline.front_m, count + 1)
    middles = (ends[1:] + ends[:-1]) / 2
    assert np.array(offsets) == pytest.approx(middles, abs=1e-9)
    assert radius == pytest.approx(np.hypot(ends[1] - middles[0], outline.width_m / 2))
    # the evaluation has the circles of the controller
    seen = Outline(outline.front_m, outline.rear_m, outline.width_m)
    evaluated = circles_of({'body.circles': count}, seen)
    assert evaluated[0] == pytest.approx(radius)
    assert evaluated[1] == pytest.approx(offsets)


def test_at_edges_half_of_the_width_counts_unless_another_radius_is_given(world):
    for asked, used in ((None, 0.91), (1.3, 1.3)):
        params, vehicle = world.load(body__circles=3, body__edge_radius_m=asked)
        assert in_force.with_covering_circles(params, vehicle).body.edge_radius_m == used
    bare = dataclasses.replace(vehicle, outline=CarOutline(None, None, None))
    with pytest.raises(ParameterError, match=r'car\.yaml does not have outline\.front_m'):
        in_force.with_covering_circles(params, bare)


def test_each_of_several_circles_is_reported_and_the_nearest_counts(world):
    controller = Controller(*world.load('mpcc_road', candidates__most=1))
    world.set_inputs(controller, world.lane_change())
    *_, why = world.tick(controller, world.rolling(X=40.0))
    gaps = [why.values[f'v2o.1.circle_{number}'] for number in (1, 2, 3)]
    assert min(gaps) == why.values['v2o.1'] == gaps[2]  # the obstacle is ahead
    sides = {f'v2e.{side}.circle_{k}' for side in ('left', 'right') for k in (1, 3)}
    assert sides <= set(why.values)


@pytest.mark.parametrize('controller', ['mpcc', 'frenet'])
def test_the_radius_at_edges_changes_distances_to_edges_only(world, controller):
    """A car that stands beside the path between straight edges 6 m to either side."""
    situation = world.straight(obstacles=[Obstacle(1, 62.0, 1.0, 0.5, 0.0, 0.0)])
    scene = world.scene(situation)
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
