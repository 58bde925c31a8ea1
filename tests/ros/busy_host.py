"""Take processors away at random, as a busy host does from a virtual machine.

    python tests/ros/busy_host.py [SECONDS [SEED]] & python -m pytest -m ros

Every 1.5 s on average a program of highest priority computes on a processor, 3 to 200 ms at a time,
up to six times in a row. Needs the right to give real-time priority.
"""

import multiprocessing
import os
import random
import sys
import time

PRIORITY = 95  # of SCHED_FIFO, above whatever is tested
CALM_S = 1.5  # on average
TIMES = (1, 1, 1, 3, 6)
TAKEN_S = (0.003, 0.01, 0.02, 0.03, 0.05, 0.08, 0.2)
LEFT_S = (0.002, 0.01, 0.02)


def occupy(processor: int, end_s: float, seed: int) -> None:
    """Take one processor away now and then until an instant of the steady clock."""
    choose = random.Random(f'{seed} {processor}')
    os.sched_setaffinity(0, {processor})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    while time.monotonic() < end_s:
        time.sleep(choose.expovariate(1 / CALM_S))
        for _ in range(choose.choice(TIMES)):
            until = time.monotonic() + choose.choice(TAKEN_S)
            while time.monotonic() < until:
                pass
            time.sleep(choose.choice(LEFT_S))


def main() -> int:
    """Occupy every processor; 1 where the user may not."""
    seconds, seed = float((sys.argv[1:2] or [900])[0]), int((sys.argv[2:3] or [1])[0])
    end_s = time.monotonic() + seconds
    given = [(processor, end_s, seed) for processor in sorted(os.sched_getaffinity(0))]
    programs = [multiprocessing.Process(target=occupy, args=one, daemon=True) for one in given]
    for program in programs:
        program.start()
    for program in programs:
        program.join()
    return max(program.exitcode for program in programs)


if __name__ == '__main__':
    sys.exit(main())
