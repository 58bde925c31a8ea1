"""In which state a car ended, told from motion and words."""

import numpy as np
import pytest
import states

from bags.errors import BagError

S, MS = 1_000_000_000, 1_000_000


class Recorded:
    """What `states` asks of a bag: motion and words."""

    def __init__(self, monkeypatch, speed, rungs):
        at_ns = S + np.arange(len(speed)) * MS
        car = states.Motion(at_ns, at_ns, np.array(speed, float))
        monkeypatch.setattr(states, 'motion', lambda bag: car)
        words = [
            (S + 50 * MS * k, type('Why', (), {'values': {'rung': rung, 'reason': 'told'}}))
            for k, rung in enumerate(rungs)
        ]
        monkeypatch.setattr(states, 'sound', lambda bag, topic, decoder: words)

    def ending(self, begins_s, plant_lives=True):
        return states.ending(None, S + round(begins_s * S), plant_lives)


def test_a_car_that_drives_as_planned_is_ok(monkeypatch):
    bag = Recorded(monkeypatch, [15.0] * 3000, ['solved'] * 60)
    assert bag.ending(1.5) == ('OK', 0.0, ('OK',), '')


def test_a_state_counts_from_when_it_was_kept(monkeypatch):
    rungs = ['solved'] * 30 + ['shifted'] * 5 + ['braking'] * 5 + ['solved'] * 20
    bag = Recorded(monkeypatch, [15.0] * 3000, rungs)
    ending = bag.ending(1.5)
    assert ending.state == 'OK'
    assert ending.settled_s == pytest.approx(0.5, abs=0.06)
    assert ending.visited == ('degraded', 'braking', 'OK')


def test_what_was_wrong_before_the_fault_is_told_once_with_its_reason(monkeypatch):
    rungs = ['shifted', *['solved'] * 15, 'shifted', 'shifted', *['solved'] * 3]
    bag = Recorded(monkeypatch, [15.0] * 3000, rungs + ['solved'] * 39)
    assert bag.ending(1.0).before == 'degraded (shifted: told)'
    silent = Recorded(monkeypatch, [15.0] * 3000, ['solved'] * 16)
    assert silent.ending(1.5).before == 'degraded (not a word)'


def test_a_car_that_loses_speed_brakes_whatever_is_said(monkeypatch):
    speed = 15.0 - np.maximum(np.arange(3000) - 2000, 0) * 0.008
    ending = Recorded(monkeypatch, speed, ['solved'] * 60).ending(1.5)
    assert ending.visited == ('OK', 'braking')


def test_a_car_that_stands_is_stopped(monkeypatch):
    speed = np.clip(15.0 - (np.arange(4000) - 1500) * 0.01, 0.0, 15.0)
    ending = Recorded(monkeypatch, speed, ['solved'] * 31).ending(1.5)
    assert ending.state == 'stopped'
    assert ending.settled_s == pytest.approx(1.5, abs=0.1)


def test_nobody_who_says_anything_is_degraded(monkeypatch):
    ending = Recorded(monkeypatch, [15.0] * 3000, ['solved'] * 31).ending(1.5)
    assert ending.visited == ('OK', 'degraded')


def test_a_fault_after_the_end_is_told(monkeypatch):
    bag = Recorded(monkeypatch, [15.0] * 1000, ['solved'] * 20)
    with pytest.raises(BagError, match='after the end'):
        bag.ending(1.5)


def test_without_a_plant_the_last_word_counts(monkeypatch):
    rungs = ['solved'] * 35 + ['braking'] * 25
    ending = Recorded(monkeypatch, [15.0] * 1500, rungs).ending(1.5, plant_lives=False)
    assert ending.visited == ('OK', 'braking')


def test_a_word_that_comes_late_counts_from_when_it_was_said():
    heard_ns = 10**18
    assert states._instant(heard_ns, heard_ns - 1_200 * MS) == heard_ns - 1_200 * MS
    simulated_ns, another_clock_ns = 5 * S, heard_ns - 3_600 * S
    assert states._instant(simulated_ns, heard_ns) == simulated_ns
    assert states._instant(heard_ns, another_clock_ns) == heard_ns
