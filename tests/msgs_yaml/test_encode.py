"""Messages take the forms of topics.yaml, so that viewers and plotters show them as they are."""

import math

import pytest

from msgs_yaml import contract, encode
from msgs_yaml.types import Actuators, Command, Imu, VehicleState, Wheels, Why

S = 1_000_000_000
FOUR = (1.0, 2.0, 3.0, 4.0)


def test_a_heading_to_the_left_turns_the_pose_about_z():
    message = encode.odometry(VehicleState(S, 0.0, 0.0, math.pi / 2, 0.0, 0.0, 0.0))
    q = message.pose.pose.orientation
    assert (q.x, q.y) == (0.0, 0.0)
    assert (q.z, q.w) == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)))


def test_joint_arrays_are_full_so_that_none_is_an_empty_sequence():
    wheels = Wheels(S, *[FOUR] * 7)
    for message in (
        encode.command(Command(S, 1.0, 2.0, 3.0, 4.0)),
        encode.actuators(Actuators(S, 1.0, 2.0, 3.0, 4.0, FOUR)),
        encode.wheels(wheels),
    ):
        lengths = {len(message.position), len(message.velocity), len(message.effort)}
        assert lengths == {len(message.name)}


def test_each_number_of_a_wheel_stands_under_its_name():
    columns = [tuple(10.0 * k + i for i in range(4)) for k in range(7)]
    omega, torque, Fz, kappa, Fx, alpha, Fy = columns
    message = encode.wheels(Wheels(S, *columns))
    at = {name: place for place, name in enumerate(message.name)}
    for i, wheel in enumerate(('fl', 'fr', 'rl', 'rr')):
        assert message.velocity[at[f'{wheel}_spin']] == omega[i]
        assert message.effort[at[f'{wheel}_spin']] == torque[i]
        assert message.effort[at[f'{wheel}_vertical']] == Fz[i]
        assert message.position[at[f'{wheel}_longitudinal']] == kappa[i]
        assert message.effort[at[f'{wheel}_longitudinal']] == Fx[i]
        assert message.position[at[f'{wheel}_lateral']] == alpha[i]
        assert message.effort[at[f'{wheel}_lateral']] == Fy[i]


def test_each_number_of_the_actuators_stands_under_its_name():
    message = encode.actuators(Actuators(S, 0.1, 0.2, -3.0, -2.0, FOUR))
    at = {name: place for place, name in enumerate(message.name)}
    assert (message.position[at['steer']], message.velocity[at['steer']]) == (0.1, 0.2)
    assert (message.effort[at['front_axle']], message.effort[at['rear_axle']]) == (-3.0, -2.0)
    assert [message.effort[at[f'{w}_wheel']] for w in ('fl', 'fr', 'rl', 'rr')] == list(FOUR)


def test_the_imu_says_that_it_measures_no_orientation():
    assert encode.imu(Imu(S, 1.0, 2.0, 3.0)).orientation_covariance[0] == -1.0


def test_every_header_carries_the_frame_of_the_contract():
    topics = contract.load().topics
    command = encode.command(Command(S + 5, 0.1, 0.2, 3.0, 4.0))
    assert command.header.frame_id == topics['/controller/command'].frame
    assert (command.header.stamp.sec, command.header.stamp.nanosec) == (1, 5)


@pytest.mark.parametrize('word', ['12', '-1.5', 'nan', 'True', '1e3', 'inf'])
def test_a_word_that_would_come_back_as_a_number_is_rejected(word):
    with pytest.raises(ValueError, match='would be read as a number or truth'):
        encode.why(Why(S, 0, 'fine', {'reason': word}))
