"""Workers end with the program that started them, whatever ends it."""

import os
import signal
import subprocess
import sys
from multiprocessing import active_children
from pathlib import Path

import pytest
from wait_until import wait_until

from experiments.worker_pool import WorkerPool

TIMEOUT_S = 60.0
OWN_KILL = "__import__('os').kill(__import__('os').getpid(), 9)"
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


def test_a_task_that_ends_its_process_or_takes_too_long_fails_alone():
    tasks = ["__import__('os')._exit(3)", "__import__('signal').pause()", '2**3', OWN_KILL]
    with WorkerPool(1) as pool:
        ended = list(pool.finish_each(eval, [(text,) for text in tasks], limit_s=3.0))
    assert [finished.number for finished in ended] == [0, 1, 2, 3]
    assert [finished.value for finished in ended] == [None, None, 8, None]
    assert [str(finished.error) for finished in ended if finished.error] == [
        'its process ended with exit code 3',
        'its process was ended after 3 s',
        'its process was ended by SIGKILL (out of memory?)',
    ]


def test_an_error_shows_where_in_the_worker_it_was_raised():
    with WorkerPool(1) as pool, pytest.raises(ZeroDivisionError) as caught:
        pool.run(eval, [('1',), ('1 / 0',)], int)
    assert 'line 1, in <module>' in str(caught.value.__cause__)


def _children():
    return {process.pid for process in active_children()}


def test_a_process_that_ended_without_work_is_replaced():
    with WorkerPool(1) as pool:
        (first,) = pool.run(os.getpid, [()], int)
        os.kill(first, signal.SIGKILL)
        # other tests of this process may have children of their own
        wait_until(lambda: first not in _children(), TIMEOUT_S, 'a killed worker lives')
        (second,) = pool.run(os.getpid, [()], int)
    assert second != first


def test_answers_to_a_call_that_failed_are_no_answers_to_the_next():
    with WorkerPool(2) as pool:
        with pytest.raises(ZeroDivisionError):
            pool.run(eval, [('1 / 0',), ("__import__('time').sleep(0.2)",)], int)
        assert pool.run(eval, [('1',), ('2',), ('3',)], int) == [1, 2, 3]


def test_a_process_stays_with_a_group_of_tasks():
    groups = ['a', 'b', 'a', 'c', 'b', 'a']
    with WorkerPool(1) as pool:
        ended = list(pool.finish_each(eval, [('0',)] * len(groups), groups))
    assert [groups[finished.number] for finished in ended] == sorted(groups)
