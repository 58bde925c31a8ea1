"""A stamp of another time is found, wherever it stands, and costs no other sample."""

import numpy as np
import pytest

from bags.storage.invalid_messages import find_foreign_stamps

S = 10**9
WALL_NS = 1_700_000_000 * S
STAMPS = np.arange(WALL_NS, WALL_NS + 100_000_000, 1_000_000, dtype=np.int64)
LOG = STAMPS + 2_000_000  # 2 ms on its way


def rows(stamp_ns, log_ns=LOG, **options):
    return [row for row, _ in find_foreign_stamps(stamp_ns, log_ns, **options)]


def changed(row, stamp_ns):
    stamps = STAMPS.copy()
    stamps[row] = stamp_ns
    return stamps


def test_samples_of_one_time_are_all_kept():
    assert rows(STAMPS) == []
    assert rows(np.repeat(STAMPS, 2), np.repeat(LOG, 2)) == []  # sent again


@pytest.mark.parametrize('row', [0, 40, 99])
@pytest.mark.parametrize('stamp_ns', [5 * S, 2 * WALL_NS])
def test_a_stamp_far_from_the_time_of_recording_is_foreign_in_every_place(row, stamp_ns):
    assert rows(changed(row, stamp_ns)) == [row]


@pytest.mark.parametrize('by_ns', [-30_000_000, 30_000_000, -S, S])
def test_a_stamp_before_or_ahead_of_its_neighbours_costs_none_of_them(by_ns):
    assert rows(changed(40, STAMPS[40] + by_ns)) == [40]


def test_states_that_a_plant_sends_late_are_its_own():
    log_ns = LOG.copy()
    log_ns[60:] += 300 * S
    assert rows(STAMPS, log_ns) == []


def test_a_clock_of_another_machine_makes_no_sample_foreign():
    assert rows(STAMPS, LOG + 10_000 * S) == []


def test_the_reason_names_the_field_and_what_is_allowed():
    ((_, far),) = find_foreign_stamps(changed(7, 5 * S), LOG)
    assert 'header.stamp is 5.000 s, 1699999995 s from' in far
    assert 'allowed up to 600 s' in far
    ((_, back),) = find_foreign_stamps(changed(7, WALL_NS), LOG)
    assert back == 'header.stamp is 1700000000.000 s; the stamps fall back'


def test_a_second_sample_of_a_stamp_is_kept_on_request():
    stamps = changed(40, STAMPS[30])
    assert rows(stamps) == [40]
    assert rows(stamps, keep_twins=True) == []
    assert rows(changed(40, STAMPS[30] + 1), keep_twins=True) == [40]
