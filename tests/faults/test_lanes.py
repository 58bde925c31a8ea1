"""Faults beside each other: in processes of their own, one drive on the wall clock at a time."""

import fcntl
import os

import lanes
import pytest
import slot


def here(number):
    return os.getpid()


def refuse(number):
    raise ValueError(f'not {number}')


def wait_for_the_other(number, folder):
    """Return when both calls have begun: only beside each other can they."""
    (folder / str(number)).touch()
    while len(list(folder.iterdir())) < 2:
        pass
    return number


def test_one_lane_is_this_process_and_keeps_the_order():
    with lanes.Lanes(1) as lane:
        found = list(lane.results(here, [(1,), (2,), (3,)]))
    assert found == [((number,), os.getpid()) for number in (1, 2, 3)]


def test_lanes_are_processes_that_work_beside_each_other(tmp_path):
    with lanes.Lanes(2) as several:
        found = dict(several.results(wait_for_the_other, [(1, tmp_path), (2, tmp_path)]))
    assert sorted(found.values()) == [1, 2]


@pytest.mark.parametrize('count', [1, 2])
def test_what_is_put_into_the_list_meanwhile_is_done_too(count):
    to_do, done = [(1,)], []
    with lanes.Lanes(count) as several:
        for (number,), _ in several.results(here, to_do):
            done.append(number)
            if number < 3:
                to_do.append((number + 1,))
    assert done == [1, 2, 3]


@pytest.mark.parametrize('count', [1, 2])
def test_an_error_in_a_lane_is_raised(count):
    with lanes.Lanes(count) as several, pytest.raises(ValueError, match='not 1'):
        list(several.results(refuse, [(1,)]))


def test_no_lane_is_no_number_of_lanes():
    with pytest.raises(ValueError, match='lanes: 0; at least 1'):
        lanes.Lanes(0)


def test_without_real_time_priority_there_is_one_lane(monkeypatch):
    monkeypatch.setattr(lanes.os, 'sched_getaffinity', lambda pid: {0, 1})
    for may, count in ((True, 2), (False, 1)):
        monkeypatch.setattr(lanes.stalls, 'may_prefer', lambda may=may: may)
        assert lanes.default() == count


def test_a_drive_on_the_wall_clock_waits_for_another_one_and_one_in_lockstep_does_not(
    monkeypatch, tmp_path
):
    monkeypatch.setattr(slot.tempfile, 'gettempdir', lambda: str(tmp_path))

    def is_taken():
        (lock,) = tmp_path.iterdir()
        with lock.open() as handle:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return True
        return False

    with slot.drive('realtime'):
        assert is_taken()
        with slot.drive('lockstep'):
            pass
    assert not is_taken()
