"""The whole experiment over real Fast DDS, as `experiments run` drives it."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from node_graph import NUMERIC

from bags.storage import cdr, read
from msgs_yaml import conformance, contract

pytestmark = pytest.mark.smoke
GRAVITY = 9.81
CONTROLLERS = ('mpcc', 'mpcc_no_ca')


def metrics(recorded_runs, controller):
    return recorded_runs.comparison['runs'][controller]


def test_the_mpcc_drives_the_double_lane_change_without_collision(recorded_runs):
    run = metrics(recorded_runs, 'mpcc')
    assert run['completed']
    assert not run['collided']
    assert run['min_v2o_m'] > 0
    assert run['min_outline_gap_m'] > 0


def test_the_car_is_at_the_limit_of_handling(recorded_runs):
    friction = float(metrics(recorded_runs, 'mpcc')['peak_lat_acc_mps2']) / GRAVITY
    assert friction >= 0.8


def test_without_collision_avoidance_the_first_obstacle_is_hit(recorded_runs):
    run = metrics(recorded_runs, 'mpcc_no_ca')
    assert run['completed']
    assert run['min_v2o_per_obstacle_m']['1'] < 0


def test_every_state_is_answered_in_its_own_period(recorded_runs):
    for controller in CONTROLLERS:
        run = metrics(recorded_runs, controller)
        assert run['ticks'] > 100
        assert run['deadline_misses'] == 0


def test_a_command_carries_the_stamp_of_the_state_it_answers(recorded_runs):
    for controller in CONTROLLERS:
        columns = read.columns(
            recorded_runs.bag(controller), ['/vehicle/odometry', '/controller/command']
        )
        states = set(columns['/vehicle/odometry'].stamp_ns.tolist())
        commands = columns['/controller/command'].stamp_ns
        assert set(commands.tolist()) <= states
        assert np.array_equal(np.diff(commands), np.full(len(commands) - 1, 50_000_000))


def test_two_runs_give_the_same_columns_bit_for_bit(recorded_runs, again):
    first = read.columns(recorded_runs.bag('mpcc'), NUMERIC)
    second = read.columns(again.bag('mpcc'), NUMERIC)
    for topic in NUMERIC:
        for name, column in first[topic].items():
            other = getattr(second[topic], name)
            assert column.tobytes() == other.tobytes(), f'{topic} {name}'


@pytest.mark.parametrize('controller', CONTROLLERS)
def test_every_recorded_message_obeys_the_contract(recorded_runs, controller):
    bag = read.load(recorded_runs.bag(controller))
    broken = Counter()
    for name in contract.load().topics:
        recording = bag.recordings[name]
        topic = recording.topic
        for payload in recording.payloads:
            message = cdr.decode(payload, topic.schema, topic.type)
            broken.update(str(violation) for violation in conformance.check(name, message))
    assert not broken


@pytest.mark.parametrize('controller', CONTROLLERS)
def test_every_topic_keeps_its_rate_within_one_percent(recorded_runs, controller):
    bag = read.load(recorded_runs.bag(controller))
    topics = contract.load().topics
    for name in topics:
        recording = bag.recordings[name]
        rate = topics[name].rate_hz['lockstep']
        if not rate:
            assert not recording.payloads, name
            continue
        senders = 4 if topics[name].publisher == 'any' else 1
        times = np.unique(recording.log_ns)
        period = np.median(np.diff(times)) * 1e-9
        assert period * rate == pytest.approx(1.0, rel=0.01), name
        if senders == 1:
            # one message per period from the first to the last
            count = round((times[-1] - times[0]) * 1e-9 * rate) + 1
            assert len(recording.log_ns) == len(times) == count, name
        assert recording.topic.type == topics[name].type


def test_the_comparison_is_printed_and_drawn(recorded_runs):
    assert '15.6' in recorded_runs.printed
    assert '18.6' in recorded_runs.printed
    figures = recorded_runs.out / 'double_lane_change' / 'figures'
    assert list(figures.glob('*.png'))
    assert list(figures.glob('*.svg'))


def test_the_page_on_the_demo_says_what_it_gives(recorded_runs):
    runs = [metrics(recorded_runs, controller) for controller in CONTROLLERS]

    def row(name, form, *keys):
        cells = [form.format(*(pick(run, key) for key in keys)) for run in runs]
        return f'| {name} | {cells[0]} | {cells[1]} |'

    def pick(run, key):
        group, _, member = key.partition('.')
        return run[group][member] if member else run[group]

    page = (Path(__file__).parents[2] / 'docs/results.md').read_text()
    obstacles = ('min_v2o_per_obstacle_m.1', 'min_v2o_per_obstacle_m.2')
    edges = ('min_v2e_per_edge_m.left', 'min_v2e_per_edge_m.right')
    for line in (
        row('distance to obstacle 1 / 2 (safe: 0.50) [m]', '{:.2f} / {:.2f}', *obstacles),
        row('distance to the left / right edge (safe: 0.50) [m]', '{:.2f} / {:.2f}', *edges),
        row('peak sideslip angle [deg]', '{:.1f}', 'peak_sideslip_deg'),
        row('peak lateral acceleration [m/s²], of 9.3', '{:.1f}', 'peak_lat_acc_mps2'),
    ):
        assert line in page
