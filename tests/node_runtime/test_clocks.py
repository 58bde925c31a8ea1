"""The steady clock shows wall time and does not jump."""

import itertools
import time

import pytest

from node_runtime.clocks import SteadyClock

DIFFER_NS = 5_000_000  # tolerance of the five readings; NTP slews one of the clocks


def test_it_shows_wall_time_and_is_monotonic():
    clock = SteadyClock()
    before_ns, now_ns, after_ns = time.time_ns(), clock.now_ns(), time.time_ns()
    assert before_ns - DIFFER_NS <= now_ns <= after_ns + DIFFER_NS
    times = [clock.now_ns() for _ in range(1000)]
    assert times == sorted(times)


def test_a_process_that_is_stopped_while_it_reads_the_clocks_shows_wall_time(monkeypatch):
    readings, read = itertools.count(), time.monotonic_ns

    def late_once():
        if next(readings) in (0, 1):
            time.sleep(0.1)
        return read()

    monkeypatch.setattr(time, 'monotonic_ns', late_once)
    clock = SteadyClock()
    before_ns, now_ns, after_ns = time.time_ns(), clock.now_ns(), time.time_ns()
    assert before_ns - DIFFER_NS <= now_ns <= after_ns + DIFFER_NS


def test_setting_the_systems_clock_does_not_move_it(monkeypatch):
    clock = SteadyClock()
    before = clock.now_ns()
    an_hour_ahead = time.time_ns() + 3_600_000_000_000
    monkeypatch.setattr(time, 'time_ns', lambda: an_hour_ahead)
    assert 0 <= clock.now_ns() - before < 1_000_000_000
    assert SteadyClock().now_ns() == pytest.approx(an_hour_ahead, abs=1_000_000_000)
