"""The catalogue of faults, the damage to messages, and the hooks of the relay."""

import math
from pathlib import Path

import catalogue
import damage
import hooks
import numpy as np
import pytest
import suite
from nav_msgs.msg import Odometry

from msgs_yaml import encode
from msgs_yaml.types import Command, Health, Obstacle, Obstacles, Reference, VehicleState

S, MS = 1_000_000_000, 1_000_000
N = 9
PATH = Reference(S, np.arange(N) * 1.0, np.zeros(N), np.zeros(N), np.arange(N) * 0.1)


def numbers(message):
    position, twist = message.pose.pose.position, message.twist.twist
    return [position.x, position.y, twist.linear.x, *message.pose.covariance]


@pytest.mark.parametrize(('effect', 'number'), [('nan', math.nan), ('inf', math.inf)])
def test_every_number_of_a_message_is_damaged(effect, number):
    message = encode.odometry(VehicleState(S, 1.0, 2.0, 0.3, 20.0, 0.1, 0.2))
    damage.CHANGES[effect](message)
    assert np.array_equal(numbers(message), [number] * 39, equal_nan=True)


def test_numbers_written_as_text_are_damaged():
    message = encode.health(Health(S, 'plant', 0, 'running', {'steps': 7}))
    damage.CHANGES['nan'](message)
    assert message.status[0].values[0].value == 'nan'


def test_arrays_of_a_command_are_damaged():
    message = encode.command(Command(S, 0.1, 0.2, -3000.0, -2000.0))
    damage.CHANGES['nan'](message)
    assert all(map(math.isnan, (*message.position, *message.velocity, *message.effort)))


def test_every_stamp_moves_and_none_becomes_negative():
    message = encode.reference(PATH)
    damage.shift_stamps(message, 10.0)
    assert message.header.stamp.sec == 11
    assert message.poses[-1].header.stamp.nanosec == 800_000_000
    damage.shift_stamps(message, -100.0)
    assert message.header.stamp.sec == message.header.stamp.nanosec == 0


def test_every_frame_is_damaged():
    message = Odometry()
    damage.set_frames(message)
    assert message.header.frame_id == message.child_frame_id == damage.WRONG_FRAME


def test_a_thousand_obstacles_differ_in_their_number():
    message = encode.obstacles(Obstacles(S, (Obstacle(1, 5.0, 0.0, 0.5, 0.0, 0.0),)))
    damage.multiply_obstacles(message)
    assert len({marker.id for marker in message.markers}) == 1000


def test_a_kink_turns_the_rest_of_the_path_by_a_right_angle():
    message = encode.reference(PATH)
    damage.bend(message)
    x, y = np.array([(p.pose.position.x, p.pose.position.y) for p in message.poses]).T
    assert np.allclose(x[4:], 4.0)
    assert np.allclose(y[4:], np.arange(5.0))
    q = message.poses[-1].pose.orientation
    assert 2 * math.atan2(q.z, q.w) == pytest.approx(math.pi / 2)


def test_a_path_becomes_huge_has_a_gap_or_one_point():
    for change, count in (
        (damage.enlarge, 100_000),
        (damage.cut_middle, 6),
        (damage.keep_first_pose, 1),
    ):
        message = encode.reference(PATH)
        change(message)
        assert len(message.poses) == count


def write(tmp_path, line):
    path = tmp_path / 'faults.yaml'
    path.write_text(f'roads: {{}}\nfaults:\n- {line}\n')
    return path


@pytest.mark.parametrize(
    ('line', 'message'),
    [
        ('{name: a, expect: fine, within_s: 1, fault: {kill: plant}}', 'expect is one of'),
        ('{name: a, expect: OK, within_s: 1, fault: {kill: nobody}}', 'kill takes one of'),
        ('{name: a, expect: OK, within_s: 1, fault: {relay: [/clock], do: sing}}', 'do is one of'),
        ('{name: a, expect: OK, within_s: 1, fault: {kill: plant, for_s: 1}}', 'kill takes'),
        ('{name: a, expect: OK, within_s: 1, when: 3, fault: {kill: plant}}', 'unknown: when'),
    ],
)
def test_an_invalid_entry_is_refused(tmp_path, line, message):
    with pytest.raises(catalogue.CatalogueError, match=message):
        catalogue.load(write(tmp_path, line))


def test_every_topic_of_the_contract_and_every_node_is_damaged():
    faults = catalogue.load()
    damaged = {topic for fault in faults if fault.action == 'relay' for topic in fault.target}
    assert damaged == hooks.SUBSCRIBERS.keys() | hooks.PUBLISHERS.keys()
    for action in ('kill', 'freeze'):
        assert {f.target for f in faults if f.action == action} == set(catalogue.ROLES)


def test_a_selection_is_the_same_each_time_and_keeps_the_order():
    faults = catalogue.load()
    first = suite.select(faults, ['odometry_*'], 5, seed=3)
    assert first == suite.select(faults, ['odometry_*'], 5, seed=3)
    assert len(first) == 5
    assert [f for f in faults if f in first] == first
    with pytest.raises(SystemExit):
        suite.select(faults, ['nothing'], None, seed=0)


def test_the_relay_is_between_one_publisher_and_one_subscriber():
    fault = next(f for f in catalogue.load() if f.name == 'odometry_nan')
    assert hooks.remaps(fault, 'controller') == [
        '-r',
        '/vehicle/odometry:=/damaged/vehicle/odometry',
    ]
    assert hooks.remaps(fault, 'plant') == []
    assert Path(hooks.relay_command(fault, Path('go'))[1]).name == 'relay.py'


def test_the_scenario_receives_the_damaged_start_of_the_run():
    fault = next(f for f in catalogue.load() if f.name == 'run_start_torn')
    _, _, source, target, topic, *_ = hooks.relay_command(fault, Path('go'))
    remaps = {role: hooks.remaps(fault, role) for role in catalogue.ROLES}
    assert remaps.pop('scenario') == ['-r', f'{topic}:={target}{topic}']
    assert not any(remaps.values())
    assert source != target
