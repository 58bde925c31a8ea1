"""Markers have the sizes of what they stand for, and their messages obey the contract."""

import math

import numpy as np
import pytest

from bags import markers_node
from msgs_yaml import conformance, encode
from msgs_yaml.types import Obstacle, Obstacles, Prediction, Reference, RoadEdges, VehicleState, Why

S = 1_000_000_000
PARAMS = markers_node.ShapeParams(
    markers_node.OutlineParams(front_m=2.27, rear_m=2.57, width_m=1.85),
    markers_node.SafetyParams((1.2, -1.2), 1.1, 0.5, 0.4),
)
STATE = VehicleState(S, 10.0, 2.0, np.pi / 2, 20.0, 0.0, 0.0)
STAGES = np.arange(51) * 0.05
PLAN = Prediction(S, 20.0 * STAGES - STAGES**2, 0.0 * STAGES, 0.0 * STAGES, STAGES)
SCENE = {  # a straight piece of road with an obstacle, a plan, and a report
    markers_node.EDGES: RoadEdges(
        S, np.array([[0.0, 6.0], [99.0, 6.0]]), np.array([[0.0, -3.0], [99.0, -3.0]])
    ),
    markers_node.REFERENCE: Reference(
        S, np.array([0.0, 90.0]), np.zeros(2), np.zeros(2), np.array([0.0, 4.5])
    ),
    markers_node.OBSTACLES: Obstacles(S, (Obstacle(7, 40.0, 1.0, 0.8, 0.0, 0.0),)),
    markers_node.WHY: Why(S, 0, '', {'friction.front': 0.62, 'friction.rear': 1.4}),
    markers_node.PLAN: PLAN,
    markers_node.STATE: STATE,
}


def draw(values):
    """Return the message of each topic that values of topics, in this order, lead to."""
    scene, drawn = markers_node.MarkerScene(PARAMS), {}
    for topic, value in values.items():
        drawn |= scene.update(topic, value)
    return drawn


def find(message, ns):
    """Return the markers of one name, in the order of their ids."""
    return [item for item in message.markers if item.ns == ns]


def points(marker):
    return np.array([[point.x, point.y] for point in marker.points])


@pytest.fixture
def drawn():
    return draw(SCENE)


def test_messages_obey_the_contract_and_begin_anew(drawn):
    assert len(drawn) == 3
    for topic, message in drawn.items():
        assert conformance.check(topic, message) == []
        assert message.markers[0].action == message.markers[0].DELETEALL
        names = [(item.ns, item.id) for item in message.markers[1:]]
        assert len(set(names)) == len(names) > 0


def test_the_car_points_along_its_heading_and_has_its_true_outline(drawn):
    (body,) = find(drawn[markers_node.VEHICLE], 'body')
    (outline,) = find(drawn[markers_node.VEHICLE], 'outline')
    # heading along y: the body's centre lies 0.15 m behind the centre of gravity
    centre = body.pose.position
    assert (centre.x, centre.y) == pytest.approx((10.0, 2.0 + (2.27 - 2.57) / 2))
    assert (body.scale.x, body.scale.y) == pytest.approx((2.27 + 2.57, 1.85))
    assert np.ptp(points(outline), axis=0) == pytest.approx([1.85, 4.84])
    assert points(outline)[:, 1].max() == pytest.approx(2.0 + 2.27)
    turned = draw({markers_node.STATE: STATE._replace(psi=0.4)})[markers_node.VEHICLE]
    turn = find(turned, 'body')[0].pose.orientation
    assert 2 * math.atan2(turn.z, turn.w) == pytest.approx(0.4)


def test_friction_use_is_a_bar_that_ends_at_the_limit(drawn):
    front, rear = find(drawn[markers_node.VEHICLE], 'friction')
    assert front.scale.z == pytest.approx(0.62 * markers_node.BAR_M[2])
    assert rear.scale.z == pytest.approx(markers_node.BAR_M[2])
    assert front.pose.position.y > rear.pose.position.y
    assert rear.color.r > front.color.r, 'redder at the limit'


@pytest.mark.parametrize('said', ['n/a', math.nan, math.inf])
def test_a_friction_use_that_is_no_number_is_not_drawn(said):
    why = Why(S, 0, '', {'friction.front': said, 'friction.rear': 0.5})
    shapes = draw(SCENE | {markers_node.WHY: why})[markers_node.VEHICLE]
    assert [item.text for item in find(shapes, 'use')] == ['rear 0.50']


def test_what_is_not_known_yet_is_not_drawn():
    shapes = draw({markers_node.STATE: STATE})
    for topic, kinds in (
        (markers_node.VEHICLE, {'body', 'outline'}),
        (markers_node.SAFETY, {'circle'}),
    ):
        assert {item.ns for item in shapes[topic].markers[1:]} == kinds


def test_areas_are_what_the_centre_of_a_circle_must_keep_out_of(drawn):
    result = drawn[markers_node.SAFETY]
    circles = find(result, 'circle')
    assert [item.scale.x for item in circles] == pytest.approx([2.2, 2.2])
    assert [item.pose.position.y for item in circles] == pytest.approx([3.2, 0.8])
    (collision,), (unsafe,) = find(result, 'collision'), find(result, 'unsafe')
    centre = collision.pose.position
    assert (collision.id, centre.x, centre.y) == (7, 40.0, 1.0)
    assert collision.scale.x == pytest.approx(2 * (0.8 + 1.1))
    assert unsafe.scale.x == pytest.approx(2 * (0.8 + 1.1 + 0.5))
    left, right = map(points, find(result, 'limit'))
    assert left[:, 1] == pytest.approx(6.0 - 1.1 - 0.4)
    assert right[:, 1] == pytest.approx(-3.0 + 1.1 + 0.4)


def test_every_disc_of_an_obstacle_is_drawn_and_the_first_one_has_its_id():
    car = Obstacle(7, 40.0, 1.0, 0.8, 0.0, 0.0, ((2.7, 0.5),))
    result = draw(SCENE | {markers_node.OBSTACLES: Obstacles(S, (car,))})[markers_node.SAFETY]
    first, second = find(result, 'collision')
    assert first.id == 7 != second.id
    assert (second.pose.position.x, second.pose.position.y) == (42.7, 1.5)


def test_the_plan_is_coloured_by_its_speed(drawn):
    def colours(message):
        (horizon,) = find(message, 'horizon')
        return np.array([[c.r, c.g, c.b, c.a] for c in horizon.colors])

    fast = colours(drawn[markers_node.PREDICTION])
    assert fast.shape == (51, 4)
    assert fast[0] == pytest.approx([*markers_node.FAST, 1.0])
    assert np.all(np.diff(fast[:-1, 0]) > 0.0), 'it brakes all the way'
    stop = PLAN._replace(X=10.0 * (1.0 - np.exp(-2.0 * STAGES)))
    slow = colours(draw({markers_node.PLAN: stop})[markers_node.PREDICTION])
    assert slow[-1] == pytest.approx([*markers_node.SLOW, 1.0])


def test_the_plans_that_were_not_chosen_are_drawn_with_the_one_that_is():
    lines = {'candidates.count': 3, 'candidates.chosen': 1}
    for k, name in enumerate(('followed', 'left of 7', 'brake')):
        lines[f'candidates.{k}.name'] = name
        lines[f'candidates.{k}.line'] = f'0.00,0.00 5.00,{k:.2f} 10.00,{2 * k:.2f}'
        lines[f'candidates.{k}.clean'] = int(k < 2)
    scene = markers_node.MarkerScene(PARAMS)
    scene.update(markers_node.PLAN, PLAN)
    ((topic, message),) = scene.update(markers_node.WHY, Why(S, 0, '', lines)).items()
    others = find(message, 'candidate')
    assert [marker.id for marker in others] == [0, 2]
    assert points(others[1])[:, 1] == pytest.approx([0.0, 2.0, 4.0])
    assert others[0].color != others[1].color, 'one of them touches'
    assert len(find(message, 'horizon')) == 1
    assert conformance.check(topic, message) == []
    # a report of another tick, or of one without candidates, draws nothing
    assert scene.update(markers_node.WHY, Why(2 * S, 0, '', lines)) == {}
    assert scene.update(markers_node.WHY, Why(S, 0, '', {})) == {}


def test_the_transform_is_the_pose_of_the_car():
    message = encode.transform(VehicleState(3 * S + 5, 1.5, -2.5, 0.4, 20.0, 0.0, 0.0))
    assert (message.header.frame_id, message.child_frame_id) == ('map', 'base_link')
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (3, 5)
    moved = message.transform
    assert (moved.translation.x, moved.translation.y) == (1.5, -2.5)
    assert 2 * math.atan2(moved.rotation.z, moved.rotation.w) == pytest.approx(0.4)
