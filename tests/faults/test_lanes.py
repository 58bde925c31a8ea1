"""Parallel faults: in processes of their own, one drive on the wall clock at a time."""

import os

import drive_lock
import lanes
import pytest
from file_locks import is_locked


def here(number):
    return os.getpid()


def refuse(number):
    raise ValueError(f'not {number}')


def wait_for_the_other(number, folder):
    """Return when both calls have begun, which needs parallel calls."""
    (folder / str(number)).touch()
    while len(list(folder.iterdir())) < 2:
        pass
    return number


def test_one_lane_is_this_process_and_keeps_the_order():
    with lanes.Lanes(1) as lane:
        results = list(lane.results(here, [(1,), (2,), (3,)]))
    assert results == [((number,), os.getpid()) for number in (1, 2, 3)]


def test_lanes_are_parallel_processes(tmp_path):
    with lanes.Lanes(2) as pool:
        results = dict(pool.results(wait_for_the_other, [(1, tmp_path), (2, tmp_path)]))
    assert sorted(results.values()) == [1, 2]


@pytest.mark.parametrize('count', [1, 2])
def test_items_added_to_the_queue_meanwhile_are_processed_too(count):
    queue, processed = [(1,)], []
    with lanes.Lanes(count) as pool:
        for (number,), _ in pool.results(here, queue):
            processed.append(number)
            if number < 3:
                queue.append((number + 1,))
    assert processed == [1, 2, 3]


@pytest.mark.parametrize('count', [1, 2])
def test_an_error_in_a_lane_is_raised(count):
    with lanes.Lanes(count) as pool, pytest.raises(ValueError, match='not 1'):
        list(pool.results(refuse, [(1,)]))


def test_zero_lanes_are_an_error():
    with pytest.raises(ValueError, match='lanes: 0; at least 1'):
        lanes.Lanes(0)


def test_without_real_time_priority_there_is_one_lane(monkeypatch):
    monkeypatch.setattr(lanes.os, 'sched_getaffinity', lambda pid: {0, 1})
    for may, count in ((True, 2), (False, 1)):
        monkeypatch.setattr(lanes.stalls, 'may_set_priority', lambda may=may: may)
        assert lanes.default() == count


def test_the_drive_lock_is_exclusive_on_the_wall_clock_and_absent_in_lockstep(
    monkeypatch, tmp_path
):
    monkeypatch.setattr(drive_lock.tempfile, 'gettempdir', lambda: str(tmp_path))

    def has_lock():
        (lock,) = tmp_path.iterdir()
        return is_locked(lock)

    with drive_lock.hold('realtime'):
        assert has_lock()
        with drive_lock.hold('lockstep'):
            pass
    assert not has_lock()
