"""The whole experiment over real Fast DDS, as `experiments run` drives it."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from node_graph import assert_equal_tables

from bags.run import load
from bags.storage import cdr, read
from experiments import simulation
from msgs_yaml import conformance, contract

pytestmark = pytest.mark.smoke
CONTROLLERS = ('mpcc', 'mpcc_no_ca', 'frenet')
RESULTS = Path(__file__).parents[2] / 'docs/results.md'


@pytest.fixture(scope='module', params=CONTROLLERS)
def drive(request, recorded_runs):
    """Return the metrics and the bag of a controller in the double lane change."""
    name = request.param
    return recorded_runs.comparison['runs'][name], read.load(recorded_runs.bag(name))


def test_every_state_is_answered_by_a_command_with_its_stamp(drive):
    run, bag = drive
    assert run['completed']
    assert run['ticks'] > 100
    assert run['fallbacks'] == run['deadline_misses'] == 0
    columns = read.columns(bag, ['/vehicle/odometry', '/controller/command'])
    commands = columns['/controller/command'].stamp_ns
    assert set(commands.tolist()) <= set(columns['/vehicle/odometry'].stamp_ns.tolist())
    assert np.array_equal(np.diff(commands), np.full(len(commands) - 1, 50_000_000))
    assert len(commands) == run['ticks'] + 1  # the state at the end is answered, too
    for name in ('/controller/why', '/controller/prediction'):
        assert len(bag.recordings[name].payloads) == len(commands)


def test_every_recorded_message_obeys_the_contract(drive):
    _, bag = drive
    broken = Counter()
    for name, described in contract.load().topics.items():
        recording = bag.recordings[name]
        assert recording.topic.type == described.type
        # of a thousand a second every tenth
        for payload in recording.payloads[:: 10 if described.rate_hz['lockstep'] > 500 else 1]:
            message = cdr.decode(payload, recording.topic.schema, recording.topic.type)
            broken.update(str(violation) for violation in conformance.check(name, message))
    assert not broken


def test_every_topic_keeps_its_rate_within_one_percent(drive):
    _, bag = drive
    for name, described in contract.load().topics.items():
        recording, rate = bag.recordings[name], described.rate_hz['lockstep']
        if not rate:
            assert not recording.payloads, name
            continue
        times = np.unique(recording.log_ns)
        assert np.median(np.diff(times)) * 1e-9 * rate == pytest.approx(1.0, rel=0.01), name
        if described.publisher != 'any':
            # one message per period from the first to the last
            count = round((times[-1] - times[0]) * 1e-9 * rate) + 1
            assert len(recording.log_ns) == len(times) == count, name


def test_over_ros_and_in_process_the_bits_are_the_same(recorded_runs):
    setup = simulation.prepare('double_lane_change', 'mpcc')
    computed, bag = simulation.run(setup), read.load(recorded_runs.bag('mpcc'))
    columns = read.columns(bag)
    assert_equal_tables(computed, columns)
    assert load(bag.path).drive.facts == simulation.drive(setup).facts


def test_the_comparison_is_printed_and_drawn(recorded_runs):
    assert '15.6' in recorded_runs.printed
    assert '18.6' in recorded_runs.printed
    figures = recorded_runs.out / 'double_lane_change' / 'figures'
    assert [file.name for file in figures.iterdir()] == ['comparison.png']


def test_the_page_on_the_demo_says_what_it_gives(recorded_runs):
    runs = [recorded_runs.comparison['runs'][name] for name in ('mpcc', 'mpcc_no_ca')]

    def row(name, form, *keys):
        cells = [form.format(*(pick(run, key) for key in keys)) for run in runs]
        return f'| {name} | {cells[0]} | {cells[1]} |'

    def pick(run, key):
        group, _, member = key.partition('.')
        return run[group][member] if member else run[group]

    obstacles = ('min_v2o_per_obstacle_m.1', 'min_v2o_per_obstacle_m.2')
    edges = ('min_v2e_per_edge_m.left', 'min_v2e_per_edge_m.right')
    page = RESULTS.read_text()
    for line in (
        row('distance to obstacle 1 / 2 (safe: 0.50) [m]', '{:.2f} / {:.2f}', *obstacles),
        row('distance to the left / right edge (safe: 0.50) [m]', '{:.2f} / {:.2f}', *edges),
        row('peak sideslip angle [deg]', '{:.1f}', 'peak_sideslip_deg'),
        row('peak lateral acceleration [m/s²], of 9.3', '{:.1f}', 'peak_lat_acc_mps2'),
    ):
        assert line in page
