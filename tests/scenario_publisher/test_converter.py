"""Objects of other programs as obstacles and predictions.

The packages of their messages are not installable here: the objects have the fields of the .msg
files of autoware_perception_msgs and derived_object_msgs.
"""

import re
import subprocess
import sys
from types import SimpleNamespace as Has

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import (
    Point32,
    Polygon,
    Pose,
    PoseWithCovariance,
    Twist,
    TwistWithCovariance,
    Vector3,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import Header
from unique_identifier_msgs.msg import UUID

from msgs_yaml import conversions, decode, encode
from node_runtime.log_filters import RejectionLog
from node_runtime.spin_node import EXIT_CONFIGURATION
from scenario_publisher import perceived_objects
from scenario_publisher.converter_node import ConverterNode
from scenario_publisher.perceived_objects import cover, from_autoware, from_derived

S = 1_000_000_000
HEADER = Header(stamp=Time(sec=7, nanosec=5), frame_id='map')
ACROSS = np.pi / 2


def pose(x, y, psi):
    result = Pose()
    result.position.x, result.position.y = float(x), float(y)
    result.orientation.z, result.orientation.w = conversions.heading_to_quaternion(psi)
    return result


def autoware(kind, dimensions, place, v=(0.0, 0.0), paths=(), footprint=()):
    covariance = np.zeros(36)
    covariance[[0, 1, 6, 7]] = 0.5, 0.1, 0.1, 0.3
    motion = Has(
        initial_pose_with_covariance=PoseWithCovariance(pose=place, covariance=covariance),
        initial_twist_with_covariance=TwistWithCovariance(
            twist=Twist(linear=Vector3(x=v[0], y=v[1]))
        ),
        predicted_paths=[
            Has(path=poses, time_step=Duration(nanosec=500_000_000), confidence=confidence)
            for confidence, poses in paths
        ],
    )
    points = [Point32(x=x, y=y) for x, y in footprint]
    shape = Has(type=kind, dimensions=Vector3(**dict(zip('xyz', dimensions))))
    shape.footprint = Polygon(points=points)
    uuid = UUID(uuid=np.array([128, 0, 0, 9, *range(12)], np.uint8))
    one = Has(object_id=uuid, existence_probability=0.9, kinematics=motion, shape=shape)
    return Has(header=HEADER, objects=[one])


def derived(*shapes):
    """Return objects 1, 2 and so on; the last one has the greatest id that there is."""
    objects = [
        Has(
            id=k if k < len(shapes) else 2**32 - 1,
            pose=pose(10 * k, 0, ACROSS),
            twist=Twist(linear=Vector3(x=3.0, y=4.0)),
            shape=SolidPrimitive(type=kind, dimensions=dimensions),
        )
        for k, (kind, dimensions) in enumerate(shapes, 1)
    ]
    return Has(header=HEADER, objects=objects)


@settings(max_examples=60)
@given(st.floats(0.3, 13.0), st.floats(0.3, 13.0), st.floats(0.1, 1.0))
def test_the_discs_cover_the_box_and_hardly_stick_out_and_fewer_would_not_do(length, width, over):
    row, radius = cover(length, width, over)
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 41) * length, np.linspace(-0.5, 0.5, 41) * width)
    nearest = np.min([np.hypot(x - a, y - b) for a, b in row], axis=0)
    assert np.max(nearest) <= radius + 1e-9
    count, (across, along) = len(row), sorted((length, width))
    assert np.hypot(*row[0]) == np.min(np.hypot(*row.T))
    if count < perceived_objects.MOST_DISCS:
        assert radius <= across / 2 + over + 1e-9
    if count > 1:  # one disc fewer, each with a longer part of the box
        assert np.hypot(along / (count - 1), across) / 2 > across / 2 + over - 1e-9


def test_a_car_of_autoware_becomes_one_object_whose_discs_turn_with_it():
    """It is 4.5 m long, heads along y at 10 m/s and slides 1 m/s to its left, -x."""
    obstacles, predictions = from_autoware(
        autoware(0, (4.5, 1.8, 1.5), pose(30, -2, ACROSS), (10.0, 1.0)), 0.3
    )
    (car,) = obstacles.items
    row, radius = cover(4.5, 1.8, 0.3)
    assert (car.id, obstacles.stamp_ns, predictions.by_id) == (0x40000004, 7 * S + 5, {})
    assert (car.vX, car.vY, car.r_obs) == pytest.approx((-1.0, 10.0, radius))
    discs = [(car.X + x, car.Y + y) for x, y in ((0.0, 0.0), *car.others)]
    assert np.allclose(discs, np.column_stack([30 - row[:, 1], -2 + row[:, 0]]))


def test_predicted_paths_are_those_of_the_first_disc_and_confidences_come_to_one_at_most():
    ahead, turns = [pose(2 * k, 0, 0) for k in range(3)], [pose(k, k, ACROSS) for k in range(4)]
    place = pose(0, 0, 0)
    paths = [(0.9, ahead), (0.6, turns), (0.0, turns), (0.3, [])]
    message = autoware(0, (8.0, 2.0, 3.0), place, paths=paths)
    obstacles, predictions = from_autoware(message, 0.5)
    (truck,) = obstacles.items
    first = truck.X  # of an even number of discs none is in the middle
    straight, left = predictions.by_id[truck.id]
    assert abs(first) > 0.5
    assert (straight.probability, left.probability) == pytest.approx((0.6, 0.4))
    assert straight.t.tolist() == [0.0, 0.5, 1.0]
    assert pytest.approx([first, 2 + first, 4 + first]) == straight.X
    assert (pytest.approx([0, 1, 2, 3]), pytest.approx(first + np.arange(4))) == (left.X, left.Y)
    assert straight.covariance[2].tolist() == [[0.5, 0.1], [0.1, 0.3]]
    received = decode.predictions(encode.predictions(predictions))
    assert (received.refused, [*received.by_id]) == ((), [truck.id])


def test_a_pedestrian_is_a_disc_and_a_polygon_one_around_its_corners():
    (walker,), _ = from_autoware(autoware(1, (0.6, 0.6, 1.8), pose(5, 1, 1.0)), 0.3)[0][1:]
    assert walker[1:4] + walker[6:] == (5.0, 1.0, 0.3, ())
    corners = [(1.0, 0.0), (-1.0, 1.0), (0.0, -0.5)]
    (thing,), _ = from_autoware(
        autoware(2, (0.0, 0.0, 1.0), pose(5, 1, 1.0), footprint=corners), 0.3
    )[0][1:]
    assert (thing.r_obs, thing.others) == (pytest.approx(np.sqrt(2)), ())


def test_objects_of_carla_have_velocities_in_the_map_and_no_predictions():
    shapes = [(1, [4.5, 1.8, 1.5]), (3, [1.8, 0.3]), (2, [0.4]), (4, [3.0, 0.5])]
    obstacles, predictions = from_derived(derived(*shapes), 0.3)
    car, walker, ball, cone = obstacles.items
    assert (predictions.stamp_ns, predictions.by_id) == (obstacles.stamp_ns, {})
    assert (car.id, car.vX, car.vY) == (1, 3.0, 4.0)
    assert len(car.others) == len(cover(4.5, 1.8, 0.3)[0]) - 1
    assert (walker.r_obs, ball.r_obs, cone.r_obs, walker.others) == (0.3, 0.4, 0.5, ())
    received = decode.obstacles(encode.obstacles(obstacles)).items
    assert [o.id for o in received] == [1, 2, 3, 2**31 - 1]


WRONG_SIZES = {
    'autoware': [(0, (np.nan, 1.8)), (0, (4.5, np.inf)), (0, (-4.5, 1.8)), (2, (1.0, 1.0))],
    'derived': [(1, []), (1, [4.5]), (1, [4.5, np.nan]), (3, [1.8]), (2, [np.inf]), (5, [1.8])],
}


@pytest.mark.parametrize('name', WRONG_SIZES)
def test_an_object_without_a_size_is_refused_alone_and_without_another_nothing_is_sent(name):
    """Obstacles without any would say that the road is free."""
    convert, make = {
        'autoware': (from_autoware, lambda kind, size: autoware(kind, size, pose(0, 0, 0))),
        'derived': (from_derived, lambda *shape: derived(shape)),
    }[name]
    wrong = [o for shape in WRONG_SIZES[name] for o in make(*shape).objects]
    good, lines, sent = make(1, (4.5, 1.8)).objects, [], []
    node = Has(params=Has(overhang_m=0.3), is_active=True, convert=convert)
    node.refusals = RejectionLog('object of /objects')
    node.get_logger = lambda: Has(warning=lines.append)
    node.obstacles_pub = Has(publish=sent.append)
    node.predictions_pub = Has(publish=lambda _: None)
    for objects in (wrong, [*wrong, *good], []):
        ConverterNode.on_objects(node, Has(header=HEADER, objects=objects))
    assert [len(decode.obstacles(message).items) for message in sent] == [1, 0]
    refused = convert(Has(header=HEADER, objects=wrong), 0.3)[0].refused
    assert lines == [f'object of /objects rejected (shape): {refused[0].reason}']
    assert [refusal.kind for refusal in refused] == ['shape'] * len(wrong)
    assert all(re.search(r'^object \d+.* its sizes are .* m; allowed', r.reason) for r in refused)


@pytest.mark.usefixtures('domain')
@pytest.mark.parametrize('kind', perceived_objects.TYPES)
def test_without_the_package_the_node_names_what_is_to_be_installed(kind):
    command = [sys.executable, '-m', 'scenario_publisher.converter_node', '--ros-args']
    done = subprocess.run(
        [*command, '-p', f'type:={kind}'], capture_output=True, text=True, timeout=60
    )
    package = kind.partition('/')[0]
    assert done.returncode == EXIT_CONFIGURATION
    apt = f'apt install ros-jazzy-{package.replace("_", "-")}'
    assert f'type: {package} is not installed; {apt}' in done.stderr
