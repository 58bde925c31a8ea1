"""Cost of bags: reading, recording, losses, how punctual the player is. Table of docs/bags.md.

    .venv/bin/python bench/recordings.py

Every figure is of real nodes over Fast DDS; the messages are those of the node graph at the
contract's rates, or with all four topics of the vehicle at 1 kHz. CPU is the processor time of the
recorder's process, which other load on the machine changes little; it does change lateness and
losses.
"""

import argparse
import json
import os
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import psutil
import rclpy
from rclpy.serialization import serialize_message
from tables import markdown

from bags.storage import read
from bags.storage.bag_writer import BagWriter
from bags.storage.message_filing import LOSS_RECORD, bag_topics
from msgs_yaml import contract, encode, flat_fields, types
from node_runtime import ros, spin_node

CHUNK_MS = 400
MINUTE_MS = 60_000
PASSES = 3
TIMEOUT_S = 120.0
SECONDS = 60  # of recording and playing
MESSAGES = 1_000_000  # in lockstep
DOMAIN = 24  # of ROS
TICK_MS = 50
PAUSE_S = 0.005  # a quarter of what the controller takes
START_NS = 1_234_567_890_000  # its bytes are nothing else in a message
NS_PER_MS = 1_000_000
MS_PER_S = 1000
STATE = ('/vehicle/odometry', '/vehicle/actuators', '/vehicle/imu', '/vehicle/wheels')
STAMP_AT = 4  # after the encapsulation header
FOUR = (1.0, 2.0, 3.0, 4.0)


def _constant():
    """One message of every topic that is not patched number by number."""
    t = np.arange(51) * 0.05
    x = 20.0 * t
    edges = np.column_stack([x, x * 0.0 + 3.0])
    values = {f'cost.term{k}': 0.1 * k for k in range(40)}
    made = {
        '/scenario/reference': encode.reference(types.Reference(START_NS, x, 0 * x, 0 * x, t)),
        '/scenario/road_edges': encode.road_edges(types.RoadEdges(START_NS, edges, edges - 6.0)),
        '/scenario/obstacles': encode.obstacles(
            types.Obstacles(START_NS, (types.Obstacle(1, 40.0, 1.5, 1.0, -5.0, 0.0),))
        ),
        '/controller/stop_plan': encode.stop_plan(types.StopPlan(START_NS, t + 0.2, 0 * x, -x, -x)),
        '/controller/prediction': encode.prediction(types.Prediction(START_NS, x, 0 * x, 0 * x, t)),
        '/controller/why': encode.why(types.Why(START_NS, 0, '', {'rung': 'solved'} | values)),
        '/diagnostics': encode.health(types.Health(START_NS, 'plant', 0, 'drives', values)),
        '/clock': encode.clock(START_NS),
    }
    return {topic: bytes(serialize_message(message)) for topic, message in made.items()}


class GraphMessages:
    """What plant, scenario and controller send, with rising stamps and changing states."""

    def __init__(self, mode: str, every_ms: bool):
        """`every_ms`: imu and wheels come at 1 kHz, too, not at the contract's rate."""
        self._templates = {topic: flat_fields.load(topic) for topic in flat_fields.TYPES}
        self._constant = _constant()
        self.topics = tuple(contract.load().topics.values())
        self._period_ms = [
            1 if every_ms and topic.name in STATE else _period_ms(topic.rate_hz[mode])
            for topic in self.topics
        ]

    def at(self, ms: int) -> Iterator[tuple[int, bytes]]:
        """Yield the index and the CDR of every message of a millisecond."""
        stamp_ns = START_NS + ms * NS_PER_MS
        for index, (topic, period) in enumerate(zip(self.topics, self._period_ms)):
            if period and ms % period == 0:
                yield index, self._data(topic, stamp_ns)

    def _data(self, topic, stamp_ns):
        if topic.name in self._templates:
            return self._templates[topic.name].fill(_value(topic.name, stamp_ns))
        data, stamp = self._constant[topic.name], _bytes(stamp_ns)
        if topic.type.endswith('MarkerArray'):
            return data.replace(_bytes(START_NS), stamp)  # every marker has one
        return data[:STAMP_AT] + stamp + data[STAMP_AT + len(stamp) :]


def _bytes(stamp_ns):
    return struct.pack('<iI', *divmod(stamp_ns, 10**9))


def _period_ms(rate_hz):
    return round(MS_PER_S / rate_hz) if rate_hz else 0


def _value(topic, stamp_ns):
    """Return a state that never repeats, so that compression finds no more than on a real drive."""
    s = stamp_ns * 1e-9
    wave = float(np.sin(s))
    if topic == '/vehicle/odometry':
        return types.VehicleState(
            stamp_ns, 20.0 * s, wave, 0.1 * wave, 20.0 - wave, wave, 0.3 * wave
        )
    if topic == '/vehicle/imu':
        return types.Imu(stamp_ns, 3.0 * wave, -5.0 * wave, 0.3 * wave)
    if topic == '/vehicle/wheels':
        loads = (4e3 + 100 * wave, 4e3 - 100 * wave, 3e3 + 90 * wave, 3e3 - 90 * wave)
        return types.Wheels(stamp_ns, FOUR, FOUR, loads, FOUR, loads, FOUR, loads)
    if topic == '/vehicle/actuators':
        return types.Actuators(stamp_ns, 0.01 * wave, 0.1 * wave, -2e3 * wave, -1e3 * wave, FOUR)
    return types.Command(stamp_ns, 0.01 * wave, 0.1 * wave, -2e3 * wave, -1e3 * wave)


def reading(folder: Path) -> dict[str, float]:
    """Write a minute of the node graph with everything at 1 kHz, read it into columns."""
    messages = GraphMessages('lockstep', every_ms=True)
    writer = BagWriter(folder / 'minute', bag_topics(contract.load(), 'lockstep'), {})
    count = 0
    for ms in range(MINUTE_MS):
        for index, data in messages.at(ms):
            log_ns = START_NS + ms * NS_PER_MS
            writer.write(index, log_ns, log_ns, data, 1 + count)
            count += 1
        if ms % CHUNK_MS == 0:
            writer.flush()
    writer.close()
    wall, cpu = [], []
    for _ in range(PASSES):
        began, began_cpu = time.perf_counter(), time.process_time()
        read.columns(folder / 'minute')
        wall.append(time.perf_counter() - began)
        cpu.append(time.process_time() - began_cpu)
    return {
        'messages': count,
        'seconds of processor': float(np.median(cpu)),
        'seconds': float(np.median(wall)),
        'MB': (folder / 'minute/minute_0.mcap').stat().st_size / 1e6,
    }


class Recording:
    """A recorder in a process of its own, and publishers of every topic in this one."""

    def __init__(self, out: Path, mode: str):
        self.out = out
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.node = rclpy.create_node('benchmark', context=self.context)
        self.node.declare_parameter('mode', mode)
        publishers = [ros.publisher(self.node, name) for name in contract.load().topics]
        self.senders = [ros.BlockingPublisher(self.node, one) for one in publishers]
        words = ['--ros-args', '-p', f'out:={out}', '-p', f'mode:={mode}']
        self.process = subprocess.Popen(
            [sys.executable, '-m', 'bags.recorder_node', *words],
            env=os.environ | {'ROS_DOMAIN_ID': str(DOMAIN)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        end = time.monotonic() + TIMEOUT_S
        while not all(one.get_subscription_count() for one in publishers):
            if time.monotonic() > end:
                raise TimeoutError('the recorder does not subscribe')
            time.sleep(0.01)
        time.sleep(1.0)
        self.cpu_before_s = self.cpu_s()

    def cpu_s(self) -> float:
        """User and system time of the recorder so far."""
        times = psutil.Process(self.process.pid).cpu_times()
        return times.user + times.system

    def end(self) -> tuple[float, read.Bag]:
        """Return the recorder's processor time and its bag."""
        time.sleep(0.5)
        cpu_s = self.cpu_s() - self.cpu_before_s
        self.close()
        return cpu_s, read.load(self.out)

    def close(self):
        """End the recorder; the bag is complete then."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(TIMEOUT_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
        spin_node.shut_down(self.node, context=self.context)


def recording(folder: Path, every_ms: bool) -> dict[str, float]:
    """Record on the wall clock."""
    messages = GraphMessages('realtime', every_ms)
    recorder = Recording(folder / f'realtime{every_ms}', 'realtime')
    sent, began = 0, time.monotonic()
    for ms in range(SECONDS * MS_PER_S):
        time.sleep(max(0.0, began + ms * 1e-3 - time.monotonic()))
        for index, data in messages.at(ms):
            recorder.senders[index].send(data)
            sent += 1
    elapsed_s = time.monotonic() - began
    cpu_s, bag = recorder.end()
    recorded = sum(len(r.payloads) for r in bag.recordings.values())
    return {
        'messages sent': sent,
        'messages per s': sent / elapsed_s,
        '% of a core': 100.0 * cpu_s / elapsed_s,
        'microseconds per message': 1e6 * cpu_s / sent,
        'lost': sent - recorded,
        'lost per 100,000': (sent - recorded) / sent * 1e5,
    }


def lockstep(folder: Path) -> dict[str, float]:
    """Record a node graph whose controller responds in PAUSE_S; publishers wait for full queues."""
    messages = GraphMessages('lockstep', every_ms=True)
    recorder = Recording(folder / 'lockstep', 'lockstep')
    sent, ms, began = 0, 0, time.monotonic()
    while sent < MESSAGES:
        for index, data in messages.at(ms):
            recorder.senders[index].send(data)
            sent += 1
        ms += 1
        if ms % TICK_MS == 0:
            time.sleep(PAUSE_S)
    elapsed_s = time.monotonic() - began
    cpu_s, bag = recorder.end()
    return {
        'messages sent': sent,
        'messages per s': sent / elapsed_s,
        'microseconds per message': 1e6 * cpu_s / sent,
        'lost where all is kept': sum(_lost_per_topic(bag, 'keep_all').values()),
        'overwritten where the newest is kept': sum(_lost_per_topic(bag, 'keep_last').values()),
    }


def _lost_per_topic(bag, history):
    """Return what the recorder noted, of the topics whose publishers keep that much in lockstep."""
    noted = {topic: json.loads(text)['lost'] for topic, text in bag.records[LOSS_RECORD].items()}
    topics = contract.load().topics.values()
    names = [topic.name for topic in topics if topic.qos['lockstep'].history == history]
    return {name: noted[name] or 0 for name in names}


def playing(folder: Path) -> dict[str, float]:
    """Play a minute at rate 1 into a recorder; when each message was sent is in the new bag."""
    if not (folder / 'minute').exists():
        reading(folder)
    recorder = Recording(folder / 'again', 'lockstep')
    words = {'bag': folder / 'minute', 'duration_s': SECONDS, 'recorders': 1}
    given = [word for name, value in words.items() for word in ('-p', f'{name}:={value}')]
    subprocess.run(
        [sys.executable, '-m', 'bags.player_node', '--ros-args', *given],
        env=os.environ | {'ROS_DOMAIN_ID': str(DOMAIN)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=True,
        timeout=SECONDS + TIMEOUT_S,
    )
    _, bag = recorder.end()
    # a message of the bag may be late, none is early
    late = [r.publish_ns - r.log_ns for r in bag.recordings.values() if r.payloads]
    late_ms = np.concatenate(late) / 1e6
    late_ms -= late_ms.min()
    return {
        'messages': len(late_ms),
        'late, median ms': float(np.percentile(late_ms, 50)),
        'late, p99 ms': float(np.percentile(late_ms, 99)),
        'late, max ms': float(late_ms.max()),
    }


PARTS = {
    'reading a minute, 1 kHz': (reading, {'seconds': 6.0}),
    'recording at the rates of the contract': (
        partial(recording, every_ms=False),
        {'% of a core': 35.0, 'lost per 100,000': 1.0},
    ),
    'recording, 1 kHz': (
        partial(recording, every_ms=True),
        {'% of a core': 55.0, 'lost per 100,000': 1.0},
    ),
    'recording in lockstep': (lockstep, {'lost where all is kept': 0.0}),
    'playing at rate 1': (playing, {'late, p99 ms': 2.0}),
}


def main() -> int:
    """Print a table per part."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    print(f'load {os.getloadavg()[0]:.1f}')
    for name, (measure, targets) in PARTS.items():
        with tempfile.TemporaryDirectory() as folder:
            found = measure(Path(folder))
        rows = [
            (
                figure,
                f'{value:,.3f}'.rstrip('0').rstrip('.'),
                f'<= {targets[figure]:g}' if figure in targets else '',
            )
            for figure, value in found.items()
        ]
        print(markdown(name, ('', 'found', 'target'), rows), flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
