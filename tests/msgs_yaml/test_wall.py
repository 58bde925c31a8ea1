"""A clock that is not moved by setting the system's, and lines that are said once."""

import time

import pytest

from msgs_yaml.wall import Spoken, Wall


def test_it_shows_wall_time_and_never_runs_back():
    wall = Wall()
    assert wall.now_ns() == pytest.approx(time.time_ns(), abs=50_000_000)
    times = [wall.now_ns() for _ in range(1000)]
    assert times == sorted(times)


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
