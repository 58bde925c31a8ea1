"""The final state of a car, from its motion and the reports of the controller."""

import numpy as np
import pytest
import states

from bags.errors import BagError

S, MS = 1_000_000_000, 1_000_000


class Recorded:
    """Replaces the motion and the reports that `states` reads from a bag."""

    def __init__(self, monkeypatch, speed, levels):
        at_ns = S + np.arange(len(speed)) * MS
        car = states.Motion(at_ns, at_ns, np.array(speed, float))
        monkeypatch.setattr(states, 'motion', lambda bag: car)
        reports = [
            (S + 50 * MS * k, type('Why', (), {'values': {'rung': level, 'reason': 'late'}}))
            for k, level in enumerate(levels)
        ]
        monkeypatch.setattr(states, 'readable_messages', lambda bag, topic, decoder: reports)

    def final_state(self, begins_s, plant_lives=True):
        return states.final_state(None, S + round(begins_s * S), plant_lives)


def test_a_car_that_drives_as_planned_is_ok(monkeypatch):
    bag = Recorded(monkeypatch, [15.0] * 3000, ['solved'] * 60)
    assert bag.final_state(1.5) == ('OK', 0.0, ('OK',), '')


def test_a_state_is_settled_when_no_other_state_follows(monkeypatch):
    levels = ['solved'] * 30 + ['shifted'] * 5 + ['braking'] * 5 + ['solved'] * 20
    bag = Recorded(monkeypatch, [15.0] * 3000, levels)
    final = bag.final_state(1.5)
    assert final.state == 'OK'
    assert final.settled_s == pytest.approx(0.5, abs=0.06)
    assert final.visited == ('degraded', 'braking', 'OK')


def test_deviations_before_the_fault_are_listed_once_with_their_reason(monkeypatch):
    levels = ['shifted', *['solved'] * 15, 'shifted', 'shifted', *['solved'] * 3]
    bag = Recorded(monkeypatch, [15.0] * 3000, levels + ['solved'] * 39)
    assert bag.final_state(1.0).before == 'degraded (shifted: late)'
    silent = Recorded(monkeypatch, [15.0] * 3000, ['solved'] * 16)
    assert silent.final_state(1.5).before == 'degraded (no report)'


def test_a_decelerating_car_is_braking_whatever_the_reports_are(monkeypatch):
    speed = 15.0 - np.maximum(np.arange(3000) - 2000, 0) * 0.008
    final = Recorded(monkeypatch, speed, ['solved'] * 60).final_state(1.5)
    assert final.visited == ('OK', 'braking')


def test_a_car_that_stands_is_stopped(monkeypatch):
    speed = np.clip(15.0 - (np.arange(4000) - 1500) * 0.01, 0.0, 15.0)
    final = Recorded(monkeypatch, speed, ['solved'] * 31).final_state(1.5)
    assert final.state == 'stopped'
    assert final.settled_s == pytest.approx(1.5, abs=0.1)


def test_a_car_without_reports_is_degraded(monkeypatch):
    final = Recorded(monkeypatch, [15.0] * 3000, ['solved'] * 31).final_state(1.5)
    assert final.visited == ('OK', 'degraded')


def test_a_fault_after_the_end_is_an_error(monkeypatch):
    bag = Recorded(monkeypatch, [15.0] * 1000, ['solved'] * 20)
    with pytest.raises(BagError, match='after the end'):
        bag.final_state(1.5)


def test_without_a_plant_the_last_report_counts(monkeypatch):
    levels = ['solved'] * 35 + ['braking'] * 25
    final = Recorded(monkeypatch, [15.0] * 1500, levels).final_state(1.5, plant_lives=False)
    assert final.visited == ('OK', 'braking')


def test_a_late_message_counts_from_when_it_was_sent():
    received_ns = 10**18
    assert states._instant(received_ns, received_ns - 1_200 * MS) == received_ns - 1_200 * MS
    simulated_ns, another_clock_ns = 5 * S, received_ns - 3_600 * S
    assert states._instant(simulated_ns, received_ns) == simulated_ns
    assert states._instant(received_ns, another_clock_ns) == received_ns
