"""The node in this process: what it says at which instants; as one of its own: why it ends."""

import subprocess
import sys
from contextlib import contextmanager
from unittest import mock

import node_bench
import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.node import Node

from msgs_yaml import decode, encode
from node_runtime import ros
from node_runtime.input_monitor import OK, STALE
from scenario_publisher import scenario
from scenario_publisher.scenario import START_NS

pytestmark = pytest.mark.ros
PATIENCE_S = 60.0
TICK_NS, BEAT_NS = 50_000_000, 250_000_000
PATH, EDGES, HEALTH = '/scenario/reference', '/scenario/road_edges', '/diagnostics'
OBSTACLES, CLOCK, RUN_START = '/scenario/obstacles', '/clock', '/vehicle/run_start'
READ = {
    PATH: decode.reference,
    EDGES: decode.road_edges,
    OBSTACLES: decode.obstacles,
    HEALTH: lambda message: decode.health(message)[0],
}


@contextmanager
def running(name, mode):
    """Run the node of a scenario; give its bench and what it sends from its start on, by topic."""
    sent = {topic: [] for topic in READ}

    def keep(topic):
        return lambda raw: sent[topic].append(READ[topic](ros.deserialize(topic, raw)))

    with node_bench.running('scenario', mode, scenario=name) as bench:
        bench.bus.listeners = {topic: [keep(topic)] for topic in READ}
        bench.renew()
        # that it looks at before it says the first instant
        with mock.patch.object(Node, 'publishers', bench.bus.publishers):
            yield bench, sent


def tick(bench, ticks):
    """Send instants of the clock."""
    for k in ticks:
        node_bench.send(bench.node, CLOCK, encode.clock(START_NS + k * TICK_NS))


def wait_for(bench, seconds):
    """Let time go by on the wall clock."""
    end_ns = bench.bus.now_ns + round(seconds * 1e9)
    while bench.bus.now_ns < end_ns:
        bench.bus.spin_once()


def stamps(values):
    return [value.stamp_ns for value in values]


def same(one, other):
    return all(np.allclose(a, b, rtol=0, atol=1e-8) for a, b in zip(one, other, strict=True))


def test_road_and_obstacles_are_published_at_the_stamps_of_the_clock():
    scn, ticks = scenario.load('moving_obstacle'), range(121)
    with running('moving_obstacle', 'lockstep') as (bench, sent):
        assert stamps(sent[PATH]) == stamps(sent[EDGES]) == [START_NS]
        tick(bench, [0])
        assert not sent[OBSTACLES]  # nobody would hear them
        ros.subscribe(bench.vehicle, OBSTACLES, lambda message: None)
        bench.bus.spin_once()  # it looks again
        tick(bench, ticks[1:])
    assert stamps(sent[OBSTACLES]) == [START_NS + k * TICK_NS for k in ticks]
    for k, seen in zip(ticks, sent[OBSTACLES]):
        wanted = scenario.obstacles_at(scn, k * TICK_NS * 1e-9, seen.stamp_ns)
        assert [o.id for o in seen.items] == [1, 2][: 1 + (k >= 100)]
        assert all(same(a[:6], b[:6]) for a, b in zip(seen.items, wanted.items, strict=True))
    for topic, wanted in ((PATH, scn.reference), (EDGES, scn.edges)):  # unchanged
        assert stamps(sent[topic]) == [START_NS + k * BEAT_NS for k in range(25)]
        assert all(same(value[1:], wanted[1:]) for value in sent[topic])
    assert stamps(sent[HEALTH]) == [START_NS + k * 20 * TICK_NS for k in range(7)]
    assert [(h.name, h.level, h.values['obstacles']) for h in sent[HEALTH]] == [
        *[('scenario', OK, 1)] * 5,
        *[('scenario', OK, 2)] * 2,
    ]


def test_time_that_goes_on_without_a_listener_of_obstacles_is_answered():
    with running('straight', 'lockstep') as (bench, sent):
        tick(bench, range(6))  # of a controller that takes no notice of obstacles
        assert stamps(sent[EDGES]) == [START_NS, START_NS + 5 * TICK_NS]
        assert {seen.items for seen in sent[OBSTACLES]} == {()}  # an empty road is said to be so


def test_on_the_wall_clock_obstacles_move_once_the_vehicle_does():
    with running('moving_obstacle', 'realtime') as (bench, sent):
        wait_for(bench, 0.5)
        assert (sent[HEALTH][0].name, sent[HEALTH][0].level) == ('scenario', STALE)
        assert 'plant' in sent[HEALTH][0].message
        assert sent[PATH]
        assert not sent[OBSTACLES]
        node_bench.send(bench.node, RUN_START, encode.run_start(0))
        wait_for(bench, 0.5)
        assert {seen.items[0].X for seen in sent[OBSTACLES]} == {60.0}
        begin_ns = bench.bus.now_ns
        node_bench.send(bench.node, RUN_START, encode.run_start(begin_ns))
        node_bench.send(bench.node, RUN_START, Time(sec=-1))  # no instant: the last one stands
        wait_for(bench, 1.0)
    assert set(np.diff(stamps(sent[OBSTACLES]))) == {TICK_NS}
    (last,) = sent[OBSTACLES][-1].items
    driven_s = (sent[OBSTACLES][-1].stamp_ns - begin_ns) * 1e-9
    assert pytest.approx(60.0 + 8.0 * driven_s, abs=1e-6) == last.X
    assert driven_s > 0.9


def test_an_unknown_or_broken_scenario_is_one_clear_line_and_a_failure(tmp_path):
    broken = tmp_path / 'broken.yaml'
    broken.write_text(scenario.load('straight').text.replace('friction: 1.0', 'friction: 7'))
    wrong = {
        'nowhere': "no scenario 'nowhere'; available: bend_inside_fast, bend",
        str(broken): f'{broken}:21: friction: is 7; allowed 0.05 to 1.5',
    }
    command = [sys.executable, '-m', 'scenario_publisher.scenario_node', '--ros-args', '-p']
    for name, message in wrong.items():
        done = subprocess.run(
            [*command, f'scenario:={name}'], capture_output=True, text=True, timeout=PATIENCE_S
        )
        assert done.returncode not in (0, None)
        assert message in done.stderr
        assert 'Traceback' not in done.stderr
