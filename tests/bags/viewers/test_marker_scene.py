"""Shapes have the sizes of what they stand for, and their messages obey the contract."""

import math

import numpy as np
import pytest

from bags import markers_node
from bags.viewers import marker_scene
from msgs_yaml import conformance, encode
from msgs_yaml.types import VehicleState, Why

from .conftest import PARAMS, PLAN

S = 1_000_000_000
TOPICS = ('/markers/vehicle', '/markers/safety', '/markers/prediction')


@pytest.mark.parametrize('topic', TOPICS)
def test_messages_obey_the_contract_and_begin_anew(drawn, topic):
    message = markers_node.marker_array(topic, S, drawn[topic])
    assert conformance.check(topic, message) == []
    assert message.markers[0].action == message.markers[0].DELETEALL
    names = [(item.ns, item.id) for item in message.markers[1:]]
    assert len(set(names)) == len(names) == len(drawn[topic])


def test_the_car_points_along_its_heading_and_has_its_true_outline(drawn, find):
    (body,) = find(drawn['/markers/vehicle'], 'body')
    (outline,) = find(drawn['/markers/vehicle'], 'outline')
    # heading along y: the body's centre lies 0.15 m behind the centre of gravity
    assert body.at[:2] == pytest.approx((10.0, 2.0 + (2.27 - 2.57) / 2))
    assert body.size[:2] == pytest.approx((2.27 + 2.57, 1.85))
    assert np.ptp(outline.points, axis=0) == pytest.approx([1.85, 4.84])
    assert outline.points[:, 1].max() == pytest.approx(2.0 + 2.27)


def test_friction_use_is_a_bar_that_ends_at_the_limit(drawn, find):
    front, rear = find(drawn['/markers/vehicle'], 'friction')
    assert front.size[2] == pytest.approx(0.62 * marker_scene.BAR_M[2])
    assert rear.size[2] == pytest.approx(marker_scene.BAR_M[2])
    assert front.at[1] > rear.at[1]
    assert rear.colour[0] > front.colour[0], 'redder at the limit'
    assert marker_scene.friction_use({'friction.front': 0.5, 'rung': 'solved'}) == {'front': 0.5}


def test_areas_are_what_the_centre_of_a_circle_must_keep_out_of(drawn, find):
    result = drawn['/markers/safety']
    assert [item.size[0] for item in find(result, 'circle')] == pytest.approx([2.2, 2.2])
    assert [item.at[1] for item in find(result, 'circle')] == pytest.approx([3.2, 0.8])
    (collision,), (unsafe,) = find(result, 'collision'), find(result, 'unsafe')
    assert (collision.id, collision.at[:2]) == (7, (40.0, 1.0))
    assert collision.size[0] == pytest.approx(2 * (0.8 + 1.1))
    assert unsafe.size[0] == pytest.approx(2 * (0.8 + 1.1 + 0.5))
    left, right = find(result, 'limit')
    assert left.points[:, 1] == pytest.approx(6.0 - 1.1 - 0.4)
    assert right.points[:, 1] == pytest.approx(-3.0 + 1.1 + 0.4)


def test_the_plan_is_coloured_by_its_speed(drawn, find):
    (horizon,) = find(drawn['/markers/prediction'], 'horizon')
    assert horizon.colours.shape == (51, 4)
    assert horizon.colours[0] == pytest.approx([*marker_scene.FAST, 1.0])
    red = horizon.colours[:, 0]
    assert np.all(np.diff(red[:-1]) > 0.0), 'it brakes all the way'
    slowest = marker_scene.speed_colours(np.array([20.0, 15.0, 3.0]))
    assert slowest[1:, :3] == pytest.approx(np.array([marker_scene.SLOW, marker_scene.SLOW]))


def test_the_plans_that_were_not_chosen_are_drawn_with_the_one_that_is(find):
    lines = {
        'candidates.count': 3,
        'candidates.chosen': 1,
    }
    for k, name in enumerate(('followed', 'left of 7', 'brake')):
        lines[f'candidates.{k}.name'] = name
        lines[f'candidates.{k}.line'] = f'0.00,0.00 5.00,{k:.2f} 10.00,{2 * k:.2f}'
        lines[f'candidates.{k}.clean'] = int(k < 2)
    scene = marker_scene.MarkerScene(PARAMS)
    scene.update(marker_scene.PLAN, PLAN)
    (drawing,) = scene.update(marker_scene.WHY, Why(S, 0, '', lines))
    others = find(drawing.shapes, 'candidate')
    assert [shape.id for shape in others] == [0, 2]
    assert others[1].points[:, 1] == pytest.approx([0.0, 2.0, 4.0])
    assert others[0].colour != others[1].colour, 'one of them touches'
    assert len(find(drawing.shapes, 'horizon')) == 1
    message = markers_node.marker_array(drawing.topic, S, drawing.shapes)
    assert conformance.check(drawing.topic, message) == []
    # a report of another tick, or of one without candidates, draws nothing
    assert scene.update(marker_scene.WHY, Why(2 * S, 0, '', lines)) == []
    assert scene.update(marker_scene.WHY, Why(S, 0, '', {})) == []


def test_what_is_not_known_yet_is_not_drawn():
    state = VehicleState(S, 0.0, 0.0, 0.0, 20.0, 0.0, 0.0)
    outline = marker_scene.OutlineParams(2.0, 2.0, 1.8)
    assert {item.ns for item in marker_scene.vehicle_shapes(state, {}, outline)} == {
        'body',
        'outline',
    }
    distances = marker_scene.SafetyParams((0.0,), 1.1, 0.5, 0.5)
    assert {item.ns for item in marker_scene.safety_shapes(state, (), None, distances)} == {
        'circle'
    }


def test_the_transform_is_the_pose_of_the_car():
    state = VehicleState(3 * S + 5, 1.5, -2.5, 0.4, 20.0, 0.0, 0.0)
    message = encode.transform(state)
    assert (message.header.frame_id, message.child_frame_id) == ('map', 'base_link')
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (3, 5)
    moved = message.transform
    assert (moved.translation.x, moved.translation.y) == (1.5, -2.5)
    assert 2 * math.atan2(moved.rotation.z, moved.rotation.w) == pytest.approx(0.4)


@pytest.mark.parametrize('said', ['n/a', math.nan, math.inf])
def test_a_friction_use_that_is_no_number_is_not_drawn(said):
    drawn = marker_scene.MarkerScene(PARAMS)
    drawn.update('/controller/why', Why(S, 0, '', {'friction.front': said, 'friction.rear': 0.5}))
    car, _ = drawn.update('/vehicle/odometry', VehicleState(S, 0.0, 0.0, 0.0, 20.0, 0.0, 0.0))
    assert [item.text for item in car.shapes if item.ns == 'use'] == ['rear 0.50']
