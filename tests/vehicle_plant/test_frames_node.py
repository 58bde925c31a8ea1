"""/tf, /tf_static and /robot_description of a driven plant, over real Fast DDS."""

import importlib.util
import json
import signal
import subprocess
import sys
import threading
from xml.etree import ElementTree

import pytest
import tf2
from plant_process import Controller, run, weave
from std_msgs.msg import String
from wait_until import wait_until

from msgs_yaml import conversions, decode
from node_runtime import ros
from vehicle_plant import robot_description
from vehicle_plant.simulator import START_NS

SECONDS = 60
OF_A_STATE = 3  # transforms: the car, and its front wheels
DRIVEN = 50 * OF_A_STATE  # that are compared: a second
PERIOD_NS = 20_000_000
DESCRIPTION = '/robot_description'


@pytest.fixture
def with_tf2(domain, tmp_path, monkeypatch):
    """Processes that are started have tf2_msgs."""
    environment = tf2.environment(tmp_path)
    for name in ('LD_LIBRARY_PATH', 'PYTHONPATH'):
        if name in environment:
            monkeypatch.setenv(name, environment[name])


@pytest.fixture
def start():
    """start(words) -> a process whose lines are collected; asked to end at the end of the test."""
    started = []

    def one(*words):
        process = subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, text=True)
        lines = []
        reader = threading.Thread(target=lambda: lines.extend(process.stdout), daemon=True)
        reader.start()
        started.append((process, reader))
        return lines

    yield one
    for process, reader in started:
        process.send_signal(signal.SIGTERM)
        assert process.wait(SECONDS) == 0
        reader.join(SECONDS)


def of(lines, child):
    """Return the received transforms of a frame by stamp."""
    items = [json.loads(line) for line in lines]
    return {item['stamp_ns']: item for item in items if item['frames'][1] == child}


def yaw(item):
    x, y, z, w = item['turn']
    assert x == y == 0.0
    return conversions.quaternion_to_heading(z, w)


@pytest.mark.slow
@pytest.mark.needs('tf2')
def test_the_plant_is_the_only_publisher_of_the_frames_of_the_car(with_tf2, start, params):
    moving = start(tf2.LISTENER, str(DRIVEN))
    fixed = start(tf2.LISTENER, '3', '/tf_static')
    start('-m', 'bags.markers_node')

    def deaf_until_the_start_is_seen(controller):
        controller.on_state = lambda stamp_ns: (
            len(moving) >= OF_A_STATE and Controller.on_state(controller, stamp_ns)
        )

    done = run(weave, before=deaf_until_the_start_is_seen, **{'stop.x_m': 60.0})
    assert done.exit_code == 0, done.log
    wait_until(lambda: len(moving) >= DRIVEN and len(fixed) >= 3, SECONDS, 'frames are missing')

    poses, wheels = of(moving, 'base_link'), of(moving, 'fl_wheel')
    assert set(poses) == set(wheels) == set(of(moving, 'fr_wheel'))
    stamps = sorted(poses)
    # markers_node would repeat a stamp, or send one between: it has those of every 50 ms
    assert len(moving) == OF_A_STATE * len(stamps)
    assert [stamp for stamp in stamps if (stamp - START_NS) % PERIOD_NS] == []
    received = done.controller.received
    states = {s.stamp_ns: s for s in map(odometry, received['odometry'])}
    actuators = {a.stamp_ns: a for a in map(servos, received['actuators'])}
    for stamp in stamps:
        x, item = states[stamp], poses[stamp]
        assert item['frames'] == ['map', 'base_link']
        assert item['at'] == [x.X, x.Y, 0.0]
        assert yaw(item) == pytest.approx(x.psi, abs=1e-12)
        assert yaw(wheels[stamp]) == pytest.approx(actuators[stamp].delta, abs=1e-12)
    assert poses[stamps[-1]]['at'][0] - poses[stamps[0]]['at'][0] > 1.0
    assert max(abs(yaw(item)) for item in wheels.values()) > 0.01

    body = {json.loads(line)['frames'][1]: json.loads(line)['at'] for line in fixed}
    expected = [f for f in robot_description.frames(params.car) if not f.is_steered]
    assert body == {f.name: [f.x, f.y, f.z] for f in expected}


def odometry(raw):
    return decode.odometry(ros.deserialize('/vehicle/odometry', raw))


def servos(raw):
    return decode.actuators(ros.deserialize('/vehicle/actuators', raw))


def listen_to_description(texts):
    """Return what makes the test controller keep the descriptions of the car that it gets."""

    def subscribe(controller):
        profile = ros.qos_profile(controller, DESCRIPTION)
        controller.create_subscription(
            String, 'robot_description', lambda msg: texts.append(msg.data), profile
        )

    return subscribe


def test_whoever_comes_late_gets_the_description_once(domain, params):
    texts = []

    def answers_once_described(stamp_ns):
        return weave(stamp_ns) if texts else None

    listen = listen_to_description(texts)
    settings = {'publish_tf': False, 'stop.x_m': 5.0}
    done = run(answers_once_described, mode='realtime', before=listen, **settings)
    assert done.exit_code == 0, done.log
    assert texts == [robot_description.urdf(params.car)]
    ElementTree.fromstring(texts[0].encode())
    assert 'tf2_msgs' not in done.log  # nobody asked for it


@pytest.mark.skipif(bool(importlib.util.find_spec('tf2_msgs')), reason='tf2_msgs is installed')
def test_a_plant_without_tf2_says_so_once_and_drives(domain):
    done = run(weave, **{'stop.x_m': 5.0})
    assert done.exit_code == 0, done.log
    assert done.log.count('tf2_msgs is not installed: no /tf') == 1
