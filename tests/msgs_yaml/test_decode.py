"""A message that violates the contract is rejected; the error names field and range."""

import math

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from msgs_yaml import decode, encode
from msgs_yaml.decode import DecodeError
from msgs_yaml.types import Actuators, Command, Imu, VehicleState, Wheels, Why

S = 1_000_000_000
FOUR = (1.0, 2.0, 3.0, 4.0)
STATE = VehicleState(S, 1.0, 2.0, 0.3, 20.0, -0.1, 0.2)
COMMAND = Command(S, 0.1, 0.2, -3000.0, -2000.0)
ACTUATORS = Actuators(S, 0.1, 0.2, -3000.0, -2000.0, FOUR)
WHEELS = Wheels(S, FOUR, FOUR, FOUR, FOUR, FOUR, (0.1, 0.2, 0.3, 0.4), FOUR)


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf, 1e9])
@pytest.mark.parametrize(
    ('path', 'allowed'),
    [
        ('pose.pose.position.x', r'-100000 to 100000 m'),
        ('pose.pose.position.y', r'-100000 to 100000 m'),
        ('twist.twist.linear.x', r'-120 to 120 m/s'),
        ('twist.twist.linear.y', r'-120 to 120 m/s'),
        ('twist.twist.angular.z', r'-20 to 20 rad/s'),
        ('pose.pose.orientation.z', r'-1 to 1 -'),
    ],
)
def test_a_number_out_of_range_is_rejected_by_name(rejects, path, allowed, bad):
    message = encode.odometry(STATE)
    *parents, last = path.split('.')
    owner = message
    for name in parents:
        owner = getattr(owner, name)
    setattr(owner, last, bad)
    rejects(decode.odometry, message, rf'/vehicle/odometry: {path} \(.*\) is .*; allowed {allowed}')


@pytest.mark.parametrize('array', ['position', 'velocity', 'effort'])
@pytest.mark.parametrize('place', range(3))
def test_nan_is_rejected_in_every_place_of_a_command(rejects, array, place):
    message = encode.command(COMMAND)
    getattr(message, array)[place] = math.nan
    rejects(decode.command, message, array)


def test_a_frame_that_is_not_the_contract_s_is_rejected(rejects):
    message = encode.odometry(STATE)
    message.header.frame_id = 'odom'
    rejects(decode.odometry, message, r"header.frame_id is 'odom'; allowed 'map'")
    message = encode.odometry(STATE)
    message.child_frame_id = 'base_footprint'
    rejects(decode.odometry, message, r"child_frame_id is 'base_footprint'; allowed 'base_link'")


def test_a_message_without_a_time_is_rejected(rejects):
    rejects(decode.imu, encode.imu(Imu(0, 1.0, 2.0, 0.1)), 'header.stamp is 0.000000000 s; allowed')


def test_a_quaternion_that_is_no_rotation_is_rejected(rejects):
    message = encode.odometry(STATE)
    message.pose.pose.orientation.w = 0.0
    rejects(decode.odometry, message, 'orientation is of squared length .*; allowed length 1')


def test_roll_is_rejected_because_a_heading_is_a_turn_about_z(rejects):
    message = encode.odometry(STATE)
    message.pose.pose.orientation.x = 0.01
    rejects(decode.odometry, message, r'orientation.x \(q_x\) is 0.01; allowed 0 to 0')


@pytest.mark.parametrize(
    ('decoder', 'message'),
    [
        (decode.command, encode.command(COMMAND)),
        (decode.actuators, encode.actuators(ACTUATORS)),
        (decode.wheels, encode.wheels(WHEELS)),
    ],
)
def test_names_must_be_those_of_the_contract_in_its_order(rejects, decoder, message):
    good, first = list(message.name), message.name[0]
    decoder(message)
    for names in ([*good[1:], first], good[:-1], [*good, 'more'], ['x', *good[1:]], []):
        message.name = names
        rejects(decoder, message, rf'name is .*; allowed {first}, ')


@pytest.mark.parametrize('array', ['position', 'velocity', 'effort'])
def test_every_array_has_one_number_per_name(rejects, array):
    message = encode.command(COMMAND)
    setattr(message, array, [0.0, 0.0])
    rejects(decode.command, message, f'{array} is 2 long; allowed 3 elements')
    setattr(message, array, [])
    rejects(decode.command, message, f'{array} is 0 long; allowed 3 elements')


def test_a_failed_tick_stays_readable():
    why = decode.why(encode.why(Why(S, 2, 'lost', {'cost.con': math.nan, 'new': 1})))
    assert math.isnan(why.values['cost.con'])
    assert why.level == 2


def test_two_statuses_are_rejected(rejects):
    message = encode.why(Why(S, 0, 'fine', {}))
    message.status.append(DiagnosticStatus())
    rejects(decode.why, message, 'status is 2 long; allowed 1 to 1 elements')


def test_a_clock_that_says_that_there_is_no_time_is_rejected():
    with pytest.raises(DecodeError, match='above 0 s'):
        decode.clock(encode.clock(0))
    assert decode.clock(encode.clock(1)) == 1
