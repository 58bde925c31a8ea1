"""Cost of bags: reading, recording, losses, how punctual the player is. Table of docs/bags.md.

    .venv/bin/python bench/recordings.py

Every figure is of real nodes over Fast DDS; the messages are those of a drive of the node graph, at
the contract's rates, or with all four topics of the vehicle at 1 kHz. CPU is the processor time of
the recorder's process, which other load on the machine changes little; it does change lateness and
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
from functools import cache, partial
from pathlib import Path

import numpy as np
import psutil
import rclpy
from equal_bags import drive
from tables import markdown

from bags.storage import read
from bags.storage.bag_writer import BagWriter
from bags.storage.message_filing import LOSS_RECORD, bag_topic
from msgs_yaml import contract, encode
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
START_NS = 1_234_567_890_000
NS_PER_MS = 1_000_000
MS_PER_S = 1000
STATE = ('/vehicle/odometry', '/vehicle/actuators', '/vehicle/imu', '/vehicle/wheels')
STAMP_AT = 4  # after the encapsulation header
MARKERS = {'/scenario/road_edges': encode.road_edges, '/scenario/obstacles': encode.obstacles}


class GraphMessages:
    """What plant, scenario and controller sent in a drive, again and again, with rising stamps."""

    def __init__(self, mode: str, every_ms: bool):
        """`every_ms`: imu and wheels come at 1 kHz, too, not at the contract's rate."""
        sent, self._topics = driven(), []
        for index, (name, topic) in enumerate(contract.load().topics.items()):
            rate_hz = MS_PER_S if every_ms and name in STATE else topic.rate_hz[mode]
            if rate_hz and name != ros.HEALTH and sent.recordings[name].payloads:
                own = read.values(sent, name) if name in MARKERS else sent.recordings[name].payloads
                self._topics.append((index, round(MS_PER_S / rate_hz), MARKERS.get(name), own))

    def at(self, ms: int) -> Iterator[tuple[int, bytes]]:
        """Yield the index and the CDR of every message of a millisecond."""
        stamp_ns = START_NS + ms * NS_PER_MS
        stamp = struct.pack('<iI', *divmod(stamp_ns, 10**9))
        for index, period, make, own in self._topics:
            if ms % period == 0:
                one = own[ms // period % len(own)]
                if make:  # every marker has a stamp
                    yield index, bytes(ros.serialize(make(one._replace(stamp_ns=stamp_ns))))
                else:
                    yield index, one[:STAMP_AT] + stamp + one[STAMP_AT + len(stamp) :]


@cache
def driven() -> read.Bag:
    """Drive once in lockstep; the bag has imu and wheels at 1 kHz."""
    with tempfile.TemporaryDirectory() as folder:
        return drive(Path(folder), 'double_lane_change', ['plant.imu_wheels_period_ms=1'])


def reading(folder: Path) -> dict[str, float]:
    """Write a minute of the node graph with everything at 1 kHz, read it into columns."""
    messages = GraphMessages('lockstep', every_ms=True)
    topics = [bag_topic(topic, 'lockstep') for topic in contract.load().topics.values()]
    writer = BagWriter(folder / 'minute', topics, {})
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


def start(module: str, **parameters: object) -> subprocess.Popen:
    """Start a node of `bags` in a process of its own."""
    given = [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]
    return subprocess.Popen(
        [sys.executable, '-m', f'bags.{module}', '--ros-args', *given],
        env=os.environ | {'ROS_DOMAIN_ID': str(DOMAIN)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


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
        self.process = start('recorder_node', out=out, mode=mode)
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
        """End the recorder; return its processor time and its bag."""
        time.sleep(0.5)
        cpu_s = self.cpu_s() - self.cpu_before_s
        self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
        spin_node.shut_down(self.node, context=self.context)
        return cpu_s, read.load(self.out)


def recording(folder: Path, mode: str, every_ms: bool) -> dict[str, float]:
    """Record on the wall clock, or a node graph whose controller responds in PAUSE_S.

    Publishers of the latter wait for full queues.
    """
    messages, in_lockstep = GraphMessages(mode, every_ms), mode == 'lockstep'
    recorder = Recording(folder / f'{mode}{every_ms}', mode)
    sent, ms, began = 0, 0, time.monotonic()
    while sent < MESSAGES if in_lockstep else ms < SECONDS * MS_PER_S:
        if not in_lockstep:
            time.sleep(max(0.0, began + ms * 1e-3 - time.monotonic()))
        elif ms and ms % TICK_MS == 0:
            time.sleep(PAUSE_S)
        for index, data in messages.at(ms):
            recorder.senders[index].send(data)
            sent += 1
        ms += 1
    elapsed_s = time.monotonic() - began
    cpu_s, bag = recorder.end()
    found = {
        'messages sent': sent,
        'messages per s': sent / elapsed_s,
        '% of a core': 100.0 * cpu_s / elapsed_s,
        'microseconds per message': 1e6 * cpu_s / sent,
    }
    if in_lockstep:
        noted = {name: json.loads(text)['lost'] for name, text in bag.records[LOSS_RECORD].items()}
        lost = dict.fromkeys(('keep_all', 'keep_last'), 0)
        for topic in contract.load().topics.values():
            lost[topic.qos[mode].history] += noted[topic.name] or 0
        return found | {
            'lost where all is kept': lost['keep_all'],
            'overwritten where the newest is kept': lost['keep_last'],
        }
    lost = sent - sum(len(one.payloads) for one in _of_contract(bag))
    return found | {'lost': lost, 'lost per 100,000': lost / sent * 1e5}


def _of_contract(bag):
    """Return what was sent here: the recorder has a health, a log and transitions of its own."""
    return [bag.recordings[name] for name in contract.load().topics if name != ros.HEALTH]


def playing(folder: Path) -> dict[str, float]:
    """Play a minute at rate 1 into a recorder; when each message was sent is in the new bag."""
    reading(folder)
    recorder = Recording(folder / 'again', 'lockstep')
    player = start('player_node', bag=folder / 'minute', duration_s=SECONDS, recorders=1)
    if code := player.wait(SECONDS + TIMEOUT_S):
        raise RuntimeError(f'the player ended with {code}')
    _, bag = recorder.end()
    # a message of the bag may be late, none is early
    late = [one.publish_ns - one.log_ns for one in _of_contract(bag)]
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
        partial(recording, mode='realtime', every_ms=False),
        {'% of a core': 35.0, 'lost per 100,000': 1.0},
    ),
    'recording, 1 kHz': (
        partial(recording, mode='realtime', every_ms=True),
        {'% of a core': 55.0, 'lost per 100,000': 1.0},
    ),
    'recording in lockstep': (
        partial(recording, mode='lockstep', every_ms=True),
        {'lost where all is kept': 0.0},
    ),
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
