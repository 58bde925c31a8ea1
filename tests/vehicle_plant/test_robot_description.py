"""The URDF is the car of the parameter file: one tree, its masses, its lengths, its steering."""

import math
from xml.etree import ElementTree

import pytest
from drives import load

from msgs_yaml import contract
from vehicle_plant import robot_description


@pytest.fixture(params=['bmw_545i.yaml', 'vw_gti.yaml'])
def car(request):
    return load(request.param).car


@pytest.fixture
def robot(car):
    return ElementTree.fromstring(robot_description.urdf(car).split('\n', 1)[1])


def numbers(element, key):
    return [float(word) for word in element.get(key).split()]


def test_body_and_wheels_hang_on_the_frame_of_the_odometry_where_those_of_the_car_are(robot, car):
    body, axles, radius = car.body, car.suspension, car.wheel.radius_m
    front, rear = body.cog_to_front_m, -body.cog_to_rear_m
    expected = {
        'body': [0.0, 0.0, body.cog_height_m],
        'fl_wheel': [front, axles.front.track_m / 2, radius],
        'fr_wheel': [front, -axles.front.track_m / 2, radius],
        'rl_wheel': [rear, axles.rear.track_m / 2, radius],
        'rr_wheel': [rear, -axles.rear.track_m / 2, radius],
    }
    joints = robot.findall('joint')
    places = {j.find('child').get('link'): numbers(j.find('origin'), 'xyz') for j in joints}
    assert places == {name: pytest.approx(place, rel=1e-8) for name, place in expected.items()}
    base = contract.load().topics['/vehicle/odometry'].child_frame
    assert {joint.find('parent').get('link') for joint in joints} == {base}
    assert [link.get('name') for link in robot.findall('link')] == [base, *expected]
    assert len({joint.get('name') for joint in joints}) == len(joints) == len(expected)
    for shape in robot.iterfind('.//cylinder/../..'):
        assert numbers(shape.find('geometry/cylinder'), 'radius') == [radius]
        # the axis of the cylinder, z, is laid across the car
        assert numbers(shape.find('origin'), 'rpy') == pytest.approx([math.pi / 2, 0.0, 0.0])


def test_mass_inertia_and_outline_are_those_of_the_whole_car(robot, car):
    body, outline = car.body, car.outline
    (inertial,) = robot.iter('inertial')
    moments = [numbers(inertial.find('inertia'), axis)[0] for axis in ('ixx', 'iyy', 'izz')]
    expected = [body.roll_inertia_kgm2, body.pitch_inertia_kgm2, body.yaw_inertia_kgm2]
    assert numbers(inertial.find('mass'), 'value') == pytest.approx([body.mass_kg], rel=1e-8)
    assert moments == pytest.approx(expected, rel=1e-8)
    box = robot.find("link[@name='body']/collision")
    length, width, height = numbers(box.find('geometry/box'), 'size')
    x, y, z = numbers(box.find('origin'), 'xyz')
    assert x + length / 2 == pytest.approx(body.cog_to_front_m + outline.front_overhang_m)
    assert x - length / 2 == pytest.approx(-body.cog_to_rear_m - outline.rear_overhang_m)
    assert (width, y) == (outline.width_m, 0.0)
    floor = body.cog_height_m + z - height / 2
    assert floor == pytest.approx(robot_description.CLEARANCE_M)


def test_the_steering_joint_is_the_one_that_commands_and_actuators_name(robot, car):
    for topic in ('/controller/command', '/vehicle/actuators'):
        assert 'steer' in contract.load().topics[topic].joints
    joint = robot.find("joint[@name='steer']")
    assert joint.find('child').get('link') == 'fl_wheel'
    steering, limit = car.steering, joint.find('limit')
    limits = [numbers(limit, name)[0] for name in ('lower', 'upper', 'velocity')]
    assert limits == [-steering.limit_rad, steering.limit_rad, steering.rate_radps]
    (mimic,) = robot.iter('mimic')
    assert mimic.get('joint') == 'steer'
