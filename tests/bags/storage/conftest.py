"""A bag of one second, and a recorder with a publisher that plays every node of the ring."""

import pytest
from one_second import every_message, write
from session_cache import build_once


@pytest.fixture
def start_recorder(start_node):
    """Factory of recorders into a folder."""
    return lambda out, **options: start_node('bags.recorder_node', out=out, **options)


@pytest.fixture
def start_pair(start_recorder, make_ring):
    """Factory of a recorder and publishers, of the same mode, that know each other."""

    def start(out, **parameters):
        mode = parameters.get('mode', 'lockstep')
        recorder, ring = start_recorder(out, **parameters), make_ring(mode)
        ring.wait_for_recorder()
        return recorder, ring

    return start


@pytest.fixture(scope='session')
def messages():
    return every_message()


@pytest.fixture(scope='session')
def bag_folder(tmp_path_factory, messages):
    """One second of every topic, as a recorder files it in lockstep; once for all workers."""
    entries = {'scenario': 'double_lane_change', 'parameters': '{"N": 50}', 'namespace': '/'}
    folder = build_once(
        tmp_path_factory, 'one_second', lambda folder: write(folder / 'mpcc', messages, entries)
    )
    return folder / 'mpcc'
