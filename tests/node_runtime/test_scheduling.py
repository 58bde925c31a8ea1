"""What is asked of Linux for a punctual process; each in a process of its own."""

import json
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
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_by_default_only_the_collector_looks_away_from_what_is_there():
    found = look()
    assert found['refused'] == []
    assert set(found['priorities']) == {0}
    assert found['locked_kb'] == 0
    assert found['collects']
    assert found['frozen'] > 1000


def test_every_thread_stays_on_the_core_that_is_asked_for():
    here = look()['cores'][0][-1]
    found = look(core=here)
    assert found['cores'] == [[here]] * len(found['cores'])
    assert len(found['cores']) >= 2
    assert found['refused'] == []


def test_a_core_that_is_not_there_is_named_with_those_that_are():
    (refusal,) = look(core=1023)['refused']
    assert refusal.startswith('realtime.core=1023: ')
    assert 'this process may use [' in refusal


def test_garbage_is_collected_no_more_on_request():
    assert not look(collect_garbage=False)['collects']


def test_priority_and_memory_are_had_by_every_thread_or_refused_with_a_remedy():
    found = look(priority=7, lock_memory=True)
    refused = ' '.join(found['refused'])
    if 'realtime.priority' in refused:
        assert 'ulimit -r 7' in refused
    else:
        assert set(found['policies']) == {1}  # SCHED_FIFO
        assert set(found['priorities']) == {7}
    if 'realtime.lock_memory' in refused:
        assert 'ulimit -l unlimited' in refused
    else:
        assert found['locked_kb'] > 1000


@pytest.mark.needs('ordinary_user')
def test_who_may_not_have_them_runs_without_and_is_told():
    found = look(ORDINARY_USER, priority=7, lock_memory=True)
    memory, priority = found['refused']
    assert memory.startswith('realtime.lock_memory: ')
    assert priority.startswith('realtime.priority=7: ')
    assert set(found['priorities']) == {0}
    assert found['locked_kb'] == 0
