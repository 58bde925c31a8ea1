"""Workers end with the program that started them, whatever ends it."""

import signal
import subprocess
import sys
from pathlib import Path

from wait_until import wait_until

TIMEOUT_S = 60.0
ASKING = """
import os, time
from experiments.worker_pool import WorkerPool
with WorkerPool(1) as pool:
    print(*pool.run(os.getpid, [()], int), flush=True)
    pool.run(time.sleep, [(1000,)], int)
"""


def lives(pid):
    """Tell whether a process is there and no zombie."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except FileNotFoundError:
        return False


def test_a_worker_ends_with_a_killed_parent():
    parent = subprocess.Popen([sys.executable, '-c', ASKING], stdout=subprocess.PIPE, text=True)
    worker = int(parent.stdout.readline())
    assert lives(worker)
    parent.send_signal(signal.SIGKILL)
    parent.wait(TIMEOUT_S)
    parent.stdout.close()
    wait_until(lambda: not lives(worker), TIMEOUT_S, 'the worker outlives its parent')
