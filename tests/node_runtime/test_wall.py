"""A clock that is not moved by setting the system's, and lines that are said once."""

import itertools
import time

import pytest

from node_runtime.wall import Spoken, Wall

DIFFER_NS = 5_000_000  # the closest of five looks at both clocks; a network sets one of them


def test_it_shows_wall_time_and_never_runs_back():
    wall = Wall()
    before_ns, now_ns, after_ns = time.time_ns(), wall.now_ns(), time.time_ns()
    assert before_ns - DIFFER_NS <= now_ns <= after_ns + DIFFER_NS
    times = [wall.now_ns() for _ in range(1000)]
    assert times == sorted(times)


def test_a_process_that_is_stopped_while_it_looks_at_the_clocks_shows_wall_time(monkeypatch):
    looks, read = itertools.count(), time.monotonic_ns

    def late_once():
        if next(looks) in (0, 1):
            time.sleep(0.1)
        return read()

    monkeypatch.setattr(time, 'monotonic_ns', late_once)
    wall = Wall()
    before_ns, now_ns, after_ns = time.time_ns(), wall.now_ns(), time.time_ns()
    assert before_ns - DIFFER_NS <= now_ns <= after_ns + DIFFER_NS


def test_setting_the_systems_clock_does_not_move_it(monkeypatch):
    wall = Wall()
    before = wall.now_ns()
    an_hour_ahead = time.time_ns() + 3_600_000_000_000
    monkeypatch.setattr(time, 'time_ns', lambda: an_hour_ahead)
    assert 0 <= wall.now_ns() - before < 1_000_000_000
    assert Wall().now_ns() == pytest.approx(an_hour_ahead, abs=1_000_000_000)


def test_a_line_is_said_once_per_change():
    spoken = Spoken()
    said = [line for line in ('', 'a', 'a', 'b', 'a', '', '') if spoken.is_news(line)]
    assert said == ['a', 'b', 'a', '']
