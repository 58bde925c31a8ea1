"""Shapes have the sizes of what they stand for, and their messages obey the contract."""

import math

import numpy as np
import pytest

from bags import markers_node
from bags.viewers import marker_scene
from msgs_yaml import conformance, encode
from msgs_yaml.types import Obstacle, Obstacles, Prediction, Reference, RoadEdges, VehicleState, Why

S = 1_000_000_000
PARAMS = marker_scene.ShapeParams(
    marker_scene.OutlineParams(front_m=2.27, rear_m=2.57, width_m=1.85),
    marker_scene.SafetyParams((1.2, -1.2), 1.1, 0.5, 0.4),
)
STATE = VehicleState(S, 10.0, 2.0, np.pi / 2, 20.0, 0.0, 0.0)
STAGES = np.arange(51) * 0.05
PLAN = Prediction(S, 20.0 * STAGES - STAGES**2, 0.0 * STAGES, 0.0 * STAGES, STAGES)
SCENE = {  # a straight piece of road with an obstacle, a plan, and a report
    marker_scene.EDGES: RoadEdges(
        S, np.array([[0.0, 6.0], [99.0, 6.0]]), np.array([[0.0, -3.0], [99.0, -3.0]])
    ),
    marker_scene.REFERENCE: Reference(
        S, np.array([0.0, 90.0]), np.zeros(2), np.zeros(2), np.array([0.0, 4.5])
    ),
    marker_scene.OBSTACLES: Obstacles(S, (Obstacle(7, 40.0, 1.0, 0.8, 0.0, 0.0),)),
    marker_scene.WHY: Why(S, 0, '', {'friction.front': 0.62, 'friction.rear': 1.4}),
    marker_scene.PLAN: PLAN,
    marker_scene.STATE: STATE,
}


def draw(values):
    """Return the shapes of each topic that values of topics, in this order, lead to."""
    scene, drawn = marker_scene.MarkerScene(PARAMS), {}
    for topic, value in values.items():
        drawn |= {drawing.topic: drawing.shapes for drawing in scene.update(topic, value)}
    return drawn


def find(shapes, ns):
    """Return the shapes of one name, in the order of their ids."""
    return [item for item in shapes if item.ns == ns]


@pytest.fixture
def drawn():
    return draw(SCENE)


def test_messages_obey_the_contract_and_begin_anew(drawn):
    assert len(drawn) == 3
    for topic, shapes in drawn.items():
        message = markers_node.marker_array(topic, S, shapes)
        assert conformance.check(topic, message) == []
        assert message.markers[0].action == message.markers[0].DELETEALL
        names = [(item.ns, item.id) for item in message.markers[1:]]
        assert len(set(names)) == len(names) == len(shapes)


def test_the_car_points_along_its_heading_and_has_its_true_outline(drawn):
    (body,) = find(drawn[marker_scene.VEHICLE], 'body')
    (outline,) = find(drawn[marker_scene.VEHICLE], 'outline')
    # heading along y: the body's centre lies 0.15 m behind the centre of gravity
    assert body.at[:2] == pytest.approx((10.0, 2.0 + (2.27 - 2.57) / 2))
    assert body.size[:2] == pytest.approx((2.27 + 2.57, 1.85))
    assert np.ptp(outline.points, axis=0) == pytest.approx([1.85, 4.84])
    assert outline.points[:, 1].max() == pytest.approx(2.0 + 2.27)


def test_friction_use_is_a_bar_that_ends_at_the_limit(drawn):
    front, rear = find(drawn[marker_scene.VEHICLE], 'friction')
    assert front.size[2] == pytest.approx(0.62 * marker_scene.BAR_M[2])
    assert rear.size[2] == pytest.approx(marker_scene.BAR_M[2])
    assert front.at[1] > rear.at[1]
    assert rear.colour[0] > front.colour[0], 'redder at the limit'


@pytest.mark.parametrize('said', ['n/a', math.nan, math.inf])
def test_a_friction_use_that_is_no_number_is_not_drawn(said):
    why = Why(S, 0, '', {'friction.front': said, 'friction.rear': 0.5})
    shapes = draw(SCENE | {marker_scene.WHY: why})[marker_scene.VEHICLE]
    assert [item.text for item in find(shapes, 'use')] == ['rear 0.50']


def test_what_is_not_known_yet_is_not_drawn():
    shapes = draw({marker_scene.STATE: STATE})
    assert {item.ns for item in shapes[marker_scene.VEHICLE]} == {'body', 'outline'}
    assert {item.ns for item in shapes[marker_scene.SAFETY]} == {'circle'}


def test_areas_are_what_the_centre_of_a_circle_must_keep_out_of(drawn):
    result = drawn[marker_scene.SAFETY]
    assert [item.size[0] for item in find(result, 'circle')] == pytest.approx([2.2, 2.2])
    assert [item.at[1] for item in find(result, 'circle')] == pytest.approx([3.2, 0.8])
    (collision,), (unsafe,) = find(result, 'collision'), find(result, 'unsafe')
    assert (collision.id, collision.at[:2]) == (7, (40.0, 1.0))
    assert collision.size[0] == pytest.approx(2 * (0.8 + 1.1))
    assert unsafe.size[0] == pytest.approx(2 * (0.8 + 1.1 + 0.5))
    left, right = find(result, 'limit')
    assert left.points[:, 1] == pytest.approx(6.0 - 1.1 - 0.4)
    assert right.points[:, 1] == pytest.approx(-3.0 + 1.1 + 0.4)


def test_the_plan_is_coloured_by_its_speed(drawn):
    (horizon,) = find(drawn[marker_scene.PREDICTION], 'horizon')
    assert horizon.colours.shape == (51, 4)
    assert horizon.colours[0] == pytest.approx([*marker_scene.FAST, 1.0])
    assert np.all(np.diff(horizon.colours[:-1, 0]) > 0.0), 'it brakes all the way'
    stop = PLAN._replace(X=10.0 * (1.0 - np.exp(-2.0 * STAGES)))
    (horizon,) = find(draw({marker_scene.PLAN: stop})[marker_scene.PREDICTION], 'horizon')
    assert horizon.colours[-1] == pytest.approx([*marker_scene.SLOW, 1.0])


def test_the_plans_that_were_not_chosen_are_drawn_with_the_one_that_is():
    lines = {'candidates.count': 3, 'candidates.chosen': 1}
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


def test_the_transform_is_the_pose_of_the_car():
    message = encode.transform(VehicleState(3 * S + 5, 1.5, -2.5, 0.4, 20.0, 0.0, 0.0))
    assert (message.header.frame_id, message.child_frame_id) == ('map', 'base_link')
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (3, 5)
    moved = message.transform
    assert (moved.translation.x, moved.translation.y) == (1.5, -2.5)
    assert 2 * math.atan2(moved.rotation.z, moved.rotation.w) == pytest.approx(0.4)
