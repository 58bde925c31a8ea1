"""The URDF is the car of the parameter file: one tree, its masses, its lengths, its steering."""

import math
from xml.etree import ElementTree

import pytest
from installation import ROOT

from msgs_yaml import contract
from node_runtime.parameters import load as load_parameters
from vehicle_plant import parameters, robot_description

CARS = sorted(
    path.name
    for path in (ROOT / 'vehicle_plant/config').glob('*.yaml')
    if 'car:' in path.read_text() or 'commonroad_multi_body' in path.read_text()
)
WHEELS = ('fl_wheel', 'fr_wheel', 'rl_wheel', 'rr_wheel')


def load(name):
    path = parameters.config_file(name)
    return load_parameters(parameters.NodeParams, path).car


@pytest.fixture(params=CARS)
def car(request):
    return load(request.param)


@pytest.fixture
def robot(car):
    return ElementTree.fromstring(robot_description.urdf(car).split('\n', 1)[1])


def numbers(text):
    return [float(word) for word in text.split()]


def places(robot):
    """Return the origin of the joint above each link, all of which hang on base_link."""
    joints = robot.findall('joint')
    assert {joint.find('parent').get('link') for joint in joints} == {'base_link'}
    return {j.find('child').get('link'): numbers(j.find('origin').get('xyz')) for j in joints}


def test_every_shipped_car_is_tried():
    assert {'bmw_545i.yaml', 'vw_gti.yaml', 'commonroad_320i.yaml'} <= set(CARS)


def test_every_link_but_the_root_hangs_on_one_joint(robot):
    links = [link.get('name') for link in robot.findall('link')]
    assert links[0] == contract.load().topics['/vehicle/odometry'].child_frame
    assert len(set(links)) == len(links)
    assert sorted(places(robot)) == sorted(links[1:])
    names = [joint.get('name') for joint in robot.findall('joint')]
    assert len(set(names)) == len(names)


def test_wheels_stand_on_the_road_at_axles_and_track(robot, car):
    at, axles = places(robot), car.suspension
    front, rear = car.body.cog_to_front_m, -car.body.cog_to_rear_m
    tracks = (axles.front.track_m, -axles.front.track_m, axles.rear.track_m, -axles.rear.track_m)
    for name, x, track in zip(WHEELS, (front, front, rear, rear), tracks):
        assert at[name] == pytest.approx([x, track / 2, car.wheel.radius_m])
    for name in WHEELS:
        shape = robot.find(f"link[@name='{name}']/visual")
        assert float(shape.find('geometry/cylinder').get('radius')) == car.wheel.radius_m
        # the axis of the cylinder, z, is laid across the car
        assert numbers(shape.find('origin').get('rpy')) == pytest.approx([math.pi / 2, 0.0, 0.0])


def test_the_collision_box_is_the_outline(robot, car):
    box = robot.find("link[@name='body']/collision")
    length, width, height = numbers(box.find('geometry/box').get('size'))
    x, y, z = numbers(box.find('origin').get('xyz'))
    at_x, at_y, at_z = places(robot)['body']
    nose = car.body.cog_to_front_m + car.outline.front_overhang_m
    tail = car.body.cog_to_rear_m + car.outline.rear_overhang_m
    assert at_x + x + length / 2 == pytest.approx(nose)
    assert at_x + x - length / 2 == pytest.approx(-tail)
    assert (width, at_y + y) == (car.outline.width_m, 0.0)
    floor = at_z + z - height / 2
    assert floor == pytest.approx(robot_description.CLEARANCE_M)


def test_mass_and_inertia_are_those_of_the_whole_car(robot, car):
    (inertial,) = robot.iter('inertial')
    assert float(inertial.find('mass').get('value')) == pytest.approx(car.body.mass_kg, rel=1e-8)
    moments = [float(inertial.find('inertia').get(axis)) for axis in ('ixx', 'iyy', 'izz')]
    body = car.body
    expected = [body.roll_inertia_kgm2, body.pitch_inertia_kgm2, body.yaw_inertia_kgm2]
    assert moments == pytest.approx(expected, rel=1e-8)
    assert places(robot)['body'] == pytest.approx([0.0, 0.0, car.body.cog_height_m], rel=1e-8)


def test_the_steering_joint_is_the_one_that_commands_and_actuators_name(robot, car):
    joint = robot.find("joint[@name='steer']")
    for topic in ('/controller/command', '/vehicle/actuators'):
        assert 'steer' in contract.load().topics[topic].joints
    assert joint.find('child').get('link') == 'fl_wheel'
    limit = joint.find('limit')
    assert float(limit.get('upper')) == -float(limit.get('lower')) == car.steering.limit_rad
    assert float(limit.get('velocity')) == car.steering.rate_radps
    (mimic,) = robot.iter('mimic')
    assert mimic.get('joint') == 'steer'
