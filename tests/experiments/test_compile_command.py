"""What `experiments compile` has compiled drives without a C compiler; nothing else does."""

import os
import subprocess
import sys

import pytest
import quick_compiler

pytestmark = [pytest.mark.needs('compiler'), pytest.mark.ros]
RUN = ('run', 'straight', '--controller', 'mpcc', '--set', 'plant.stop.x_m=20')
RUN += ('--set', 'plant.stop.armed_after_m=1')
NODES = {
    'mpcc_controller.controller_node': 'path_queries',  # what it loads first
    'vehicle_plant.plant_node': 'vehicle_plant',
}


@pytest.fixture
def ahead(tmp_path):
    """Return the environment of a machine without a compiler, and the empty cache of it."""
    cache = tmp_path / 'cache'
    return os.environ | {'MPCC_CACHE_DIR': str(cache), 'CC': 'no-such-compiler'}, cache


def experiments(env, *words):
    command = [sys.executable, '-m', 'experiments.cli', *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, env=env)


def test_what_was_compiled_ahead_drives_without_a_compiler(ahead, tmp_path):
    env, cache = ahead
    done = experiments(env | {'CC': quick_compiler.write(tmp_path)}, 'compile', 'mpcc')
    assert done.returncode == 0, done.stderr
    compiled = {file: file.stat().st_mtime_ns for file in cache.glob('*.so')}
    assert {file.name.split('-')[0] for file in compiled} >= {'vehicle_plant', 'mpcc_riccati'}
    done = experiments(env, *RUN, '--out', tmp_path / 'runs')
    assert done.returncode == 0, done.stderr
    assert {file: file.stat().st_mtime_ns for file in cache.glob('*.so')} == compiled


def test_without_compiler_and_libraries_a_run_is_refused_before_a_node_starts(ahead, tmp_path):
    env, cache = ahead
    done = experiments(env, *RUN, '--out', tmp_path / 'runs')
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert f'no C compiler for path_queries, and no library of it is in {cache}: ' in line
    assert not (tmp_path / 'runs').exists()


@pytest.mark.parametrize('node', NODES)
@pytest.mark.usefixtures('domain')
def test_a_node_without_compiler_and_libraries_refuses_to_start(ahead, node):
    env, cache = ahead
    command = [sys.executable, '-m', node]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=env)
    assert done.returncode == os.EX_CONFIG
    last = done.stderr.splitlines()[-1]
    assert f'no C compiler for {NODES[node]}, and no library of it is in {cache}: ' in last
    assert 'MPCC_CACHE_DIR' in last
