"""A run on the wall clock: it begins when all are ready, and every tick is accounted for."""

import os
import subprocess
import sys

import numpy as np
import pytest

from bags.storage import read
from bags.verdict import punctuality
from msgs_yaml import decode

pytestmark = pytest.mark.ros
DOMAIN = '65'
SECONDS = 120
STATE, COMMAND = '/vehicle/odometry', '/controller/command'
TICK_NS = 50_000_000


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Four seconds of the double lane change."""
    out = tmp_path_factory.mktemp('realtime')
    command = [sys.executable, '-m', 'bags.cli', 'run', 'double_lane_change']
    command += ['--mode', 'realtime', '--out', out, '--set', 'plant.stop.time_s=4.0']
    subprocess.run(
        command, env={**os.environ, 'ROS_DOMAIN_ID': DOMAIN}, capture_output=True, timeout=SECONDS
    )
    return read.load(out / 'double_lane_change' / 'mpcc')


def stamps(bag, topic):
    return np.array([decode.stamp_ns_of(data) for data in bag.recordings[topic].payloads])


def test_the_car_is_held_at_its_start_until_the_controller_answers(bag):
    table = read.columns(bag, [STATE, COMMAND])
    first = table[COMMAND].stamp_ns[0]
    held = table[STATE].x_m[table[STATE].stamp_ns <= first]
    assert len(held) > 1
    assert set(held) == {held[0]}
    assert table[STATE].x_m[-1] > held[0] + 10.0
    assert first in table[STATE].stamp_ns


def test_every_tick_of_the_bag_is_accounted_for(bag):
    """How many are missed depends on what else this machine does: bench/realtime.py tells."""
    found = punctuality.report(bag)
    assert found['mode'] == 'realtime'
    ticks, parts = found['ticks'], punctuality.parts(bag)
    drive_ns = stamps(bag, STATE)[-1] - stamps(bag, COMMAND)[0]
    assert ticks['count'] >= drive_ns // TICK_NS - 1
    assert drive_ns > 2e9  # a car that was told nothing for too long stands before its time is over
    assert 0 < len(parts.total) <= ticks['count'] + 1 - ticks['unanswered']
    assert np.min(parts.transport) > 0.0
    assert np.min(parts.rest) >= 0.0
    assert sum(parts[1:]) == pytest.approx(parts.total)


def test_health_goes_from_waiting_to_well_and_names_ages(bag):
    healths = read.values(bag, '/diagnostics')
    plant = [one for one in healths if one.name == 'plant']
    controller = [one for one in healths if one.name == 'controller']
    for told in (plant, controller):
        levels = [one.level for one in told]
        running = next(k for k, level in enumerate(levels) if level != 3)
        assert 3 not in levels[running:]  # a short wait may be over before it is told
    began = [one.values['run_began_ns'] for one in plant if 'run_began_ns' in one.values]
    assert len(set(began)) == 1
    assert began[0] == pytest.approx(stamps(bag, COMMAND)[0], abs=1e9)
    for name in ('state', 'reference', 'edges', 'obstacles'):
        assert controller[-1].values[f'age.{name}_worst_ms'] > 0.0
        least = min(one.values.get(f'age.{name}_ms', np.inf) for one in controller)
        assert least < controller[-1].values[f'age.{name}_limit_ms']
