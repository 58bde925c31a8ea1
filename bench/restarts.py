"""How often is a process that was killed and started again deaf? docs/faults.md, by transport.

    .venv/bin/python bench/restarts.py [--kills 60]

One process publishes at 1 kHz, two at 20 Hz; a fourth hears all of them. It is killed (SIGKILL)
after a random time and started again: first one that ends properly at once, as a recorder whose
folder exists, then one that is to hear the three within 20 s. This is done with the shared memory
that rmw_fastrtps uses by default, and with the transport of our nodes (`node_runtime/transport.py`
says why it is another). Exit code 1 when a process did not hear the others with the latter.
"""

import argparse
import os
import random
import selectors
import subprocess
import sys
import time
from functools import partial

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.task import Future
from rclpy.utilities import get_rmw_implementation_identifier
from std_msgs.msg import String

from experiments.run import domain
from node_runtime import transport

PERIODS_S = {'fast': 0.001, 'slow_1': 0.05, 'slow_2': 0.05}
TOPICS = 4  # per publisher
MESSAGE = String(data='x' * 600)  # about as long as a state
LONGEST_LIFE_S = 0.3
DEAF_S = 20.0
LISTENER, ENDS_AT_ONCE = 'listener', 'ends_at_once'  # roles beside the publishers
SHARED_MEMORY = {transport.RANGE: transport.LOCALHOST, 'FASTDDS_BUILTIN_TRANSPORTS': 'DEFAULT'}


def publish(name: str) -> None:
    """Publish on all topics of a publisher, and hear the fast one, until the process is killed."""
    rclpy.init()
    node = rclpy.create_node(name, start_parameter_services=False)
    publishers = [node.create_publisher(String, f'{name}_{k}', 10) for k in range(TOPICS)]
    node.create_subscription(String, 'fast_0', lambda message: None, 10)
    node.create_timer(PERIODS_S[name], lambda: [one.publish(MESSAGE) for one in publishers])
    _spin(node)


def listen() -> None:
    """Print the name of each publisher once, when its first message comes, until killed."""
    rclpy.init()
    node = rclpy.create_node(LISTENER, start_parameter_services=False)
    heard = set()

    def hear(name, message):
        if name not in heard:
            heard.add(name)
            print(name, flush=True)

    for name in PERIODS_S:
        for k in range(TOPICS):
            node.create_subscription(String, f'{name}_{k}', partial(hear, name), 50)
    _spin(node)


def end_at_once() -> None:
    """Begin and end a node."""
    rclpy.init()
    rclpy.create_node(LISTENER).destroy_node()
    rclpy.shutdown()


def _spin(node):
    executor = EventsExecutor()
    executor.add_node(node)
    while True:  # without a time-out it runs no callback in the wheels of Jazzy
        executor.spin_until_future_complete(Future(), timeout_sec=1.0)


def hearing_times(kills: int, environment: dict[str, str]) -> list[float | None]:
    """Return after how many seconds each new process heard all; None for one that did not."""

    def start(role):
        command = [sys.executable, __file__, '--role', role]
        return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE)

    running = [start(name) for name in PERIODS_S]
    try:
        running.append(start(LISTENER))
        if _wait(running[-1]) is None:
            raise RuntimeError('the first process did not hear the others')
        found = []
        for _ in range(kills):
            time.sleep(random.uniform(0.0, LONGEST_LIFE_S))
            _kill(running.pop())
            start(ENDS_AT_ONCE).communicate()
            running.append(start(LISTENER))
            found.append(_wait(running[-1]))
        return found
    finally:
        for process in running:
            _kill(process)


def _wait(listener):
    """Return after how many seconds a process has heard all publishers, None after DEAF_S."""
    begin, heard = time.monotonic(), ''
    with selectors.DefaultSelector() as selector:
        selector.register(listener.stdout, selectors.EVENT_READ)
        while (left_s := begin + DEAF_S - time.monotonic()) > 0.0:
            if selector.select(left_s):
                if not (text := os.read(listener.stdout.fileno(), 1000).decode()):
                    raise RuntimeError(f'a process ended with {listener.wait()}')
                heard += text
            if all(name in heard for name in PERIODS_S):
                return time.monotonic() - begin
    return None


def _kill(process):
    process.kill()
    process.communicate()


def main() -> int:
    """Print a line per transport; return 1 when ours left a process deaf."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--kills', type=int, default=60)
    roles = {name: partial(publish, name) for name in PERIODS_S}
    roles |= {LISTENER: listen, ENDS_AT_ONCE: end_at_once}
    parser.add_argument('--role', choices=roles, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.role:
        roles[given.role]()
        return 0
    clean = {name: text for name, text in os.environ.items() if name not in transport.VARIABLES}
    ours = dict(clean)
    transport.configure(ours, get_rmw_implementation_identifier())
    deaf = 0
    with domain.reserved(os.environ) as number:
        for name, environment in (('shared memory', clean | SHARED_MEMORY), ('ours', ours)):
            found = hearing_times(given.kills, environment | {'ROS_DOMAIN_ID': str(number)})
            heard = sorted(one for one in found if one is not None)
            deaf = len(found) - len(heard)
            print(f'{name}: {deaf} of {len(found)} did not hear all others', end='')
            if heard:
                median_s = heard[len(heard) // 2]
                print(f'; the rest did after {median_s:.1f} s, {heard[-1]:.1f} s at most', end='')
            print(flush=True)
    return int(deaf > 0)


if __name__ == '__main__':
    sys.exit(main())
