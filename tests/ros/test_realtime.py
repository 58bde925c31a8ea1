"""A run on the wall clock: it begins when all are ready, and its nodes say how they are."""

import numpy as np
import pytest
from node_graph import OF_PROCESSES
from rich.console import Console

from bags.evaluation import bag_summary
from bags.storage import read
from experiments.run import run_and_compare

pytestmark = OF_PROCESSES
SECONDS = 240  # of wall time
STATE, COMMAND = '/vehicle/odometry', '/controller/command'
TICK_NS = 50_000_000


@pytest.fixture(scope='module')
def bag(tmp_path_factory, wall_clock):
    """Four seconds of the double lane change."""
    out = tmp_path_factory.mktemp('realtime')
    # a command that comes late because other processes have the machine does not stop the car
    settings = ['plant.stop.time_s=4.0', 'plant.command_age_s=1.0', *wall_clock.settings()]
    request = run_and_compare.Request(
        'double_lane_change', ['mpcc'], 'realtime', out, settings, SECONDS
    )
    with wall_clock.own_drive():
        _, (outcome,) = run_and_compare.run_controllers(request, Console(quiet=True))
    # it is cut short before the finish line, and says so; nothing else may end it
    assert 'finish line not reached within 4 s' in outcome.message
    return read.load(outcome.bag)


def test_the_car_is_held_at_its_start_until_the_controller_answers(bag):
    table = read.columns(bag, [STATE, COMMAND, '/vehicle/run_start'])
    states = table[STATE]
    *held, began_ns = table['/vehicle/run_start'].stamp_ns.tolist()
    assert held in ([], [0])  # the car may be held for less than a period of this topic
    # where the machine is busy, the recorder may hear a command only after the first one
    first = table[COMMAND].stamp_ns[0]
    assert began_ns - TICK_NS <= first <= began_ns + 1e9
    assert first in states.stamp_ns
    held = states.x_m[states.stamp_ns <= began_ns]
    assert len(held) > 1
    assert set(held) == {held[0]}
    assert states.x_m[-1] > held[0] + 10.0


def test_the_parts_of_a_tick_lie_between_its_state_and_its_command(bag):
    """Their sums and counts: tests/bags/storage/test_info.py. Of a machine: bench/realtime.py."""
    total, *parts, publish, rest = bag_summary.tick_parts(bag)
    assert len(total)
    assert all((part > 0.0).all() for part in parts)
    assert min(publish.min(), rest.min()) >= 0.0


def test_health_goes_from_waiting_to_well_and_names_ages(bag):
    healths = read.values(bag, '/diagnostics')
    for name in ('plant', 'controller'):
        levels = [health.level for health in healths if health.name == name]
        running = next(k for k, level in enumerate(levels) if level != 3)
        assert 3 not in levels[running:]  # a short wait may be over before it is reported
    controller = [health.values for health in healths if health.name == 'controller']
    for name in ('state', 'reference', 'edges', 'obstacles'):
        assert controller[-1][f'age.{name}_worst_ms'] > 0.0
        least = min(values.get(f'age.{name}_ms', np.inf) for values in controller)
        assert least < controller[-1][f'age.{name}_limit_ms']
