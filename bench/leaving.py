"""How often Fast DDS holds a process that leaves while others do, with and without hearing them.

    .venv/bin/python bench/leaving.py [--processes 10] [--times 100] [--domain 34]

Each process makes a node with publishers and subscriptions, waits for the next common instant,
destroys the node, and begins anew. One that is held for 3 s is counted, ended and replaced. Half of
the rounds are left as rclpy does, hearing of the others, half as `spin_node.shut_down` does. See
`node_runtime/shutdown.py` for why; a build of Fast DDS with a newer C++ library holds nobody.
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

LEAVE_S = 3.0
HELD = 9  # exit code
TOPICS = 8
LEAST_S = 0.6  # to make a node and be found
PERIOD_S = 1.6  # between two common instants
LOOK_S = 0.1
LEFT = 'left'  # how a line begins that says so; Fast DDS may write between them


def leave_again_and_again(number: int, times: int, hears: bool) -> None:
    """Make a node and leave, so often, at common instants."""
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
        time.sleep(wait_s if wait_s > LEAST_S else wait_s + PERIOD_S)
        with shutdown.exit_after(LEAVE_S, HELD):
            if hears:
                node.destroy_node()
                rclpy.shutdown(context=context)
            else:
                spin_node.shut_down(node, context=context)


def held(processes: int, times: int, hears: bool, environment: dict[str, str]) -> int:
    """Return how many ends were held, of `processes` times `times`."""

    def start(number, left):
        words = [sys.executable, __file__, '--leave', str(number), '--times', str(left)]
        words += ['--hears'] if hears else []
        pipes = {'stdout': subprocess.PIPE, 'stderr': subprocess.DEVNULL, 'text': True}
        return subprocess.Popen(words, env=environment, **pipes)

    running = {number: start(number, times) for number in range(processes)}
    count = 0
    try:
        while running:
            time.sleep(LOOK_S)
            for number, process in list(running.items()):
                if process.poll() is None:
                    continue
                left = int(re.findall(rf'^{LEFT} (\d+)$', process.stdout.read(), re.M)[-1]) - 1
                if process.returncode not in (0, HELD):
                    raise RuntimeError(f'a process ended with {process.returncode}')
                count += process.returncode == HELD
                del running[number]
                if process.returncode == HELD and left:
                    running[number] = start(number, left)
    finally:
        for process in running.values():
            process.kill()
    return count


def main() -> int:
    """Count, show, and fail when a process that hears nothing was held."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--processes', type=int, default=10)
    parser.add_argument('--times', type=int, default=100)
    parser.add_argument('--domain', type=int, default=34)
    parser.add_argument('--leave', type=int, help=argparse.SUPPRESS)
    parser.add_argument('--hears', action='store_true', help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.leave is not None:
        leave_again_and_again(given.leave, given.times, given.hears)
        return 0
    here = {'ROS_DOMAIN_ID': str(given.domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    ends, failed = given.processes * given.times, False
    for hears, how in ((True, 'as rclpy does'), (False, 'as spin_node.shut_down does')):
        count = held(given.processes, given.times, hears, os.environ | here)
        print(f'{how}: {count} of {ends} held', flush=True)
        failed = failed or (count > 0 and not hears)
    return int(failed)


if __name__ == '__main__':
    sys.exit(main())
