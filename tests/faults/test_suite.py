"""The suite itself: what it reads, what it does to messages, and how it judges."""

import math
from pathlib import Path

import catalogue
import damage
import hooks
import numpy as np
import pytest
import states
import suite
import table
from nav_msgs.msg import Odometry

from bags.errors import BagError
from msgs_yaml import encode
from msgs_yaml.types import Command, Health, Obstacle, Obstacles, Reference, VehicleState

S, MS = 1_000_000_000, 1_000_000
N = 9
PATH = Reference(S, np.arange(N) * 1.0, np.zeros(N), np.zeros(N), np.arange(N) * 0.1)


def numbers(message):
    position, twist = message.pose.pose.position, message.twist.twist
    return [position.x, position.y, twist.linear.x, *message.pose.covariance]


@pytest.mark.parametrize(('deed', 'number'), [('nan', math.nan), ('inf', math.inf)])
def test_every_number_of_a_message_is_harmed(deed, number):
    message = encode.odometry(VehicleState(S, 1.0, 2.0, 0.3, 20.0, 0.1, 0.2))
    damage.CHANGES[deed](message)
    assert np.array_equal(numbers(message), [number] * 39, equal_nan=True)


def test_numbers_written_as_text_are_harmed():
    message = encode.health(Health(S, 'plant', 0, 'running', {'steps': 7}))
    damage.CHANGES['nan'](message)
    assert message.status[0].values[0].value == 'nan'


def test_arrays_of_a_command_are_harmed():
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


def test_every_frame_is_harmed():
    message = Odometry()
    damage.set_frames(message)
    assert message.header.frame_id == message.child_frame_id == damage.WRONG_FRAME


def test_a_thousand_obstacles_differ_in_their_number():
    message = encode.obstacles(Obstacles(S, (Obstacle(1, 5.0, 0.0, 0.5, 0.0, 0.0),)))
    damage.thousand(message)
    assert len({marker.id for marker in message.markers}) == 1000


def test_a_kink_turns_the_rest_of_the_path_by_a_right_angle():
    message = encode.reference(PATH)
    damage.kink(message)
    x, y = np.array([(p.pose.position.x, p.pose.position.y) for p in message.poses]).T
    assert np.allclose(x[4:], 4.0)
    assert np.allclose(y[4:], np.arange(5.0))
    q = message.poses[-1].pose.orientation
    assert 2 * math.atan2(q.z, q.w) == pytest.approx(math.pi / 2)


def test_a_path_becomes_huge_has_a_gap_or_one_point():
    for change, count in ((damage.swell, 100_000), (damage.gap, 6), (damage.one_point, 1)):
        message = encode.reference(PATH)
        change(message)
        assert len(message.poses) == count


def write(tmp_path, line):
    path = tmp_path / 'faults.yaml'
    path.write_text(f'roads: {{}}\nfaults:\n- {line}\n')
    return path


@pytest.mark.parametrize(
    ('line', 'told'),
    [
        ('{name: a, expect: fine, within_s: 1, fault: {kill: plant}}', 'expect is one of'),
        ('{name: a, expect: OK, within_s: 1, fault: {kill: nobody}}', 'kill takes one of'),
        ('{name: a, expect: OK, within_s: 1, fault: {relay: [/clock], do: sing}}', 'do is one of'),
        ('{name: a, expect: OK, within_s: 1, fault: {kill: plant, for_s: 1}}', 'kill takes'),
        ('{name: a, expect: OK, within_s: 1, when: 3, fault: {kill: plant}}', 'unknown: when'),
    ],
)
def test_an_entry_that_cannot_be_used_is_refused(tmp_path, line, told):
    with pytest.raises(catalogue.CatalogueError, match=told):
        catalogue.load(write(tmp_path, line))


def test_every_topic_of_the_contract_and_every_node_is_harmed():
    faults = catalogue.load()
    harmed = {topic for fault in faults if fault.does == 'relay' for topic in fault.to}
    assert harmed == hooks.HEARS.keys() | hooks.SPEAKS.keys()
    for deed in ('kill', 'freeze'):
        assert {f.to for f in faults if f.does == deed} == set(catalogue.ROLES)


def test_a_choice_is_the_same_each_time_and_keeps_the_order():
    faults = catalogue.load()
    first = suite.chosen(faults, ['odometry_*'], 5, seed=3)
    assert first == suite.chosen(faults, ['odometry_*'], 5, seed=3)
    assert len(first) == 5
    assert [f for f in faults if f in first] == first
    with pytest.raises(SystemExit):
        suite.chosen(faults, ['nothing'], None, seed=0)


class Recorded:
    """What `states` asks of a bag: motion and words."""

    def __init__(self, monkeypatch, speed, rungs):
        at_ns = S + np.arange(len(speed)) * MS
        car = states.Motion(at_ns, at_ns, np.array(speed, float))
        monkeypatch.setattr(states, 'motion', lambda bag: car)
        words = [
            (S + 50 * MS * k, type('Why', (), {'values': {'rung': rung}}))
            for k, rung in enumerate(rungs)
        ]
        monkeypatch.setattr(states, 'sound', lambda bag, topic, decoder: words)

    def ending(self, begins_s, plant_lives=True):
        return states.ending(None, S + round(begins_s * S), plant_lives)


def test_a_car_that_drives_as_planned_is_ok(monkeypatch):
    bag = Recorded(monkeypatch, [15.0] * 3000, ['solved'] * 60)
    assert bag.ending(1.5) == ('OK', 0.0, ('OK',), True)


def test_a_state_counts_from_when_it_was_kept(monkeypatch):
    rungs = ['solved'] * 30 + ['shifted'] * 5 + ['braking'] * 5 + ['solved'] * 20
    bag = Recorded(monkeypatch, [15.0] * 3000, rungs)
    ending = bag.ending(1.5)
    assert ending.state == 'OK'
    assert ending.settled_s == pytest.approx(0.5, abs=0.06)
    assert ending.visited == ('degraded', 'braking', 'OK')


def test_a_car_that_loses_speed_brakes_whatever_is_said(monkeypatch):
    speed = 15.0 - np.maximum(np.arange(3000) - 2000, 0) * 0.008
    ending = Recorded(monkeypatch, speed, ['solved'] * 60).ending(1.5)
    assert ending.visited == ('OK', 'braking')


def test_a_car_that_stands_is_stopped(monkeypatch):
    speed = np.clip(15.0 - (np.arange(4000) - 1500) * 0.01, 0.0, 15.0)
    ending = Recorded(monkeypatch, speed, ['solved'] * 31).ending(1.5)
    assert ending.state == 'stopped'
    assert ending.settled_s == pytest.approx(1.5, abs=0.1)


def test_nobody_who_says_anything_is_degraded(monkeypatch):
    ending = Recorded(monkeypatch, [15.0] * 3000, ['solved'] * 31).ending(1.5)
    assert ending.visited == ('OK', 'degraded')


def test_a_fault_after_the_end_is_told(monkeypatch):
    bag = Recorded(monkeypatch, [15.0] * 1000, ['solved'] * 20)
    with pytest.raises(BagError, match='after the end'):
        bag.ending(1.5)


def test_without_a_plant_the_last_word_counts(monkeypatch):
    rungs = ['solved'] * 35 + ['braking'] * 25
    ending = Recorded(monkeypatch, [15.0] * 1500, rungs).ending(1.5, plant_lives=False)
    assert ending.visited == ('OK', 'braking')


def test_the_relay_is_between_one_publisher_and_one_subscriber():
    fault = next(f for f in catalogue.load() if f.name == 'odometry_nan')
    assert hooks.remaps(fault, 'controller') == [
        '-r',
        '/vehicle/odometry:=/harmed/vehicle/odometry',
    ]
    assert hooks.remaps(fault, 'plant') == []
    assert Path(hooks.relay(fault)[1]).name == 'relay.py'


def test_harmed_health_is_heard_by_the_scenario():
    fault = next(f for f in catalogue.load() if f.name == 'diagnostics_word')
    _, _, source, target, topic, *_ = hooks.relay(fault)
    harmed = target + topic
    heard = {
        role: dict(rule.split(':=') for rule in hooks.remaps(fault, role)[1::2])
        for role in catalogue.ROLES
    }
    assert harmed == heard['scenario'].get('/diagnostics', '/diagnostics')
    assert source + topic == heard['plant']['/diagnostics'] == heard['recorder']['/diagnostics']
    assert source != target


def test_the_table_has_a_row_for_every_fault_and_says_what_failed():
    first, second, *others = catalogue.load()
    made = {
        'name': first.name,
        'expected': first.expect,
        'found': 'stopped',
        'settled_s': 1.0,
        'nonsense': 2,
        'remarks': ['is stopped'],
        'disturbed': '',
        'tries': 1,
    }
    rows = table.block([first, second, *others], {first.name: made}).splitlines()
    assert rows[0].startswith(f'0 of 1 as expected, {1 + len(others)} not run, 2 commands')
    assert '| stopped **no** | 1.00 | is stopped |' in rows[4]
    assert '| not run |' in rows[5]
    assert len(rows) == 6 + len(others)


def test_a_table_takes_the_place_of_the_one_before():
    page = f'a\n{table.BEGIN}\nold\n{table.END}\nz\n'
    assert table.written(page, 'new') == f'a\n{table.BEGIN}\nnew\n{table.END}\nz\n'
    with pytest.raises(table.TableError, match='lacks'):
        table.written('a page without', 'new')


@pytest.mark.parametrize(
    ('remarks', 'disturbed', 'unclear'),
    [
        (['is stopped'], 'not OK before the fault', True),
        (['too late'], 'the machine stood still for 0.06 s', True),
        (['is stopped'], '', False),
        (['is stopped', '1 commands that must not be'], 'not OK before the fault', False),
        (['hung: plant'], 'not OK before the fault', False),
    ],
)
def test_only_a_late_or_wrong_state_on_a_disturbed_machine_is_unclear(remarks, disturbed, unclear):
    verdict = suite.Verdict('a', 'OK', 'stopped', 1.0, 1.0, (), 0, tuple(remarks), disturbed)
    assert verdict.unclear == unclear
