"""Scheduling options of a node; each test in a process of its own."""

import json
import os
import subprocess
import sys

import pytest
from capabilities import ORDINARY_USER

LOOK = """
import gc, json, os, sys, threading
from node_runtime import scheduling
waiting = threading.Event()
threading.Thread(target=waiting.wait, daemon=True).start()
refused = scheduling.apply(scheduling.SchedulingOptions(**json.loads(sys.argv[1])))
locked = next(l for l in open('/proc/self/status') if l.startswith('VmLck')).split()[1]
threads = [int(t) for t in os.listdir('/proc/self/task')]
print(json.dumps({
    'refused': refused,
    'policies': [os.sched_getscheduler(t) for t in threads],
    'priorities': [os.sched_getparam(t).sched_priority for t in threads],
    'cores': [sorted(os.sched_getaffinity(t)) for t in threads],
    'locked_kb': int(locked),
    'collects': gc.isenabled(),
    'frozen': gc.get_freeze_count(),
}))
"""
PLAIN = {'priority': 0, 'core': -1, 'lock_memory': False, 'collect_garbage': True}


def look(prefix=(), **options):
    done = subprocess.run(
        [*prefix, sys.executable, '-c', LOOK, json.dumps(PLAIN | options)],
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_by_default_only_the_garbage_is_frozen_and_a_missing_core_is_named():
    state = look(core=1023)
    (refusal,) = state['refused']
    assert refusal.startswith('realtime.core=1023: ')
    assert 'this process may use [' in refusal
    assert set(state['priorities']) == {0}
    assert state['locked_kb'] == 0
    assert state['collects']
    assert state['frozen'] > 1000


def test_every_thread_gets_core_priority_and_locked_memory_or_a_hint_is_returned():
    here = min(os.sched_getaffinity(0))
    state = look(core=here, collect_garbage=False, priority=7, lock_memory=True)
    refused = ' '.join(state['refused'])
    assert state['cores'] == [[here]] * len(state['cores'])
    assert len(state['cores']) >= 2
    assert not state['collects']
    if 'realtime.priority' in refused:
        assert 'ulimit -r 7' in refused
    else:
        assert set(state['policies']) == {1}  # SCHED_FIFO
        assert set(state['priorities']) == {7}
    if 'realtime.lock_memory' in refused:
        assert 'ulimit -l unlimited' in refused
    else:
        assert state['locked_kb'] > 1000


@pytest.mark.needs('ordinary_user')
def test_without_permission_the_process_runs_on_and_gets_two_hints():
    state = look(ORDINARY_USER, priority=7, lock_memory=True)
    memory, priority = state['refused']
    assert memory.startswith('realtime.lock_memory: ')
    assert priority.startswith('realtime.priority=7: ')
    assert set(state['priorities']) == {0}
    assert state['locked_kb'] == 0
