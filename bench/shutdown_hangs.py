"""How often Fast DDS hangs when processes shut down together: a table of docs/faults.md.

    .venv/bin/python bench/shutdown_hangs.py [--processes 10] [--times 100] [--domain 34]

Each process creates a node with publishers and subscriptions, waits for the next common instant,
destroys the node, and repeats this. A process that hangs for 3 s is counted, ended and replaced.
Half of the rounds shut down as rclpy does, half as `spin_node.shut_down` does. See
`node_runtime/shutdown.py` for why; with a build of Fast DDS with a newer C++ library nothing hangs.
"""

import argparse
import os
import re
import subprocess
import sys
import time

import rclpy
from rclpy.context import Context
from std_msgs.msg import String

from node_runtime import shutdown, spin_node

SHUTDOWN_S = 3.0
HUNG = 9  # exit code
TOPICS = 8
DISCOVERY_S = 0.6  # to create a node and be discovered
PERIOD_S = 1.6  # between two common instants
POLL_S = 0.1
LEFT = 'left'  # prefix of a progress line; Fast DDS may write between these lines


def shut_down_repeatedly(number: int, times: int, as_rclpy: bool) -> None:
    """Create a node and shut it down, `times` times, at common instants."""
    for left in range(times):
        print(LEFT, times - left, flush=True)
        context = Context()
        rclpy.init(context=context)
        node = rclpy.create_node(f'node_{number}', context=context)
        for k in range(TOPICS):
            if k % 4 == number % 4:
                node.create_publisher(String, f'/topic_{k}', 10)
            else:
                node.create_subscription(String, f'/topic_{k}', print, 10)
        wait_s = PERIOD_S - time.time() % PERIOD_S
        time.sleep(wait_s if wait_s > DISCOVERY_S else wait_s + PERIOD_S)
        with shutdown.exit_after(SHUTDOWN_S, HUNG):
            if as_rclpy:
                node.destroy_node()
                rclpy.shutdown(context=context)
            else:
                spin_node.shut_down(node, context=context)


def count_hangs(processes: int, times: int, as_rclpy: bool, environment: dict[str, str]) -> int:
    """Return how many shutdowns hung, of `processes` times `times`."""

    def start(number, left):
        words = [sys.executable, __file__, '--leave', str(number), '--times', str(left)]
        words += ['--as-rclpy'] if as_rclpy else []
        pipes = {'stdout': subprocess.PIPE, 'stderr': subprocess.DEVNULL, 'text': True}
        return subprocess.Popen(words, env=environment, **pipes)

    running = {number: start(number, times) for number in range(processes)}
    count = 0
    try:
        while running:
            time.sleep(POLL_S)
            for number, process in list(running.items()):
                if process.poll() is None:
                    continue
                left = int(re.findall(rf'^{LEFT} (\d+)$', process.stdout.read(), re.M)[-1]) - 1
                if process.returncode not in (0, HUNG):
                    raise RuntimeError(f'a process ended with {process.returncode}')
                count += process.returncode == HUNG
                del running[number]
                if process.returncode == HUNG and left:
                    running[number] = start(number, left)
    finally:
        for process in running.values():
            process.kill()
    return count


def main() -> int:
    """Print the counts; return 1 when a shutdown by `spin_node.shut_down` hung."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--processes', type=int, default=10)
    parser.add_argument('--times', type=int, default=100)
    parser.add_argument('--domain', type=int, default=34)
    parser.add_argument('--leave', type=int, help=argparse.SUPPRESS)
    parser.add_argument('--as-rclpy', action='store_true', help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.leave is not None:
        shut_down_repeatedly(given.leave, given.times, given.as_rclpy)
        return 0
    here = {'ROS_DOMAIN_ID': str(given.domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    ends, failed = given.processes * given.times, False
    for as_rclpy, how in ((True, 'as rclpy does'), (False, 'as spin_node.shut_down does')):
        count = count_hangs(given.processes, given.times, as_rclpy, os.environ | here)
        print(f'{how}: {count} of {ends} hung', flush=True)
        failed = failed or (count > 0 and not as_rclpy)
    return int(failed)


if __name__ == '__main__':
    sys.exit(main())
