"""Below which speed a car brakes to a stop, and what is said about it."""

import dataclasses

import pytest

from mpcc_controller import minimum_speed


def test_the_text_names_the_speeds_that_are_in_force(params):
    text = minimum_speed.stopping_text(params.limits)
    assert 'slower than limits.least_speed_mps, 7 m/s' in text
    assert 'from 8 m/s' in text
    model = dataclasses.replace(params.model, low_speed=True)
    limits = minimum_speed.with_low_speed(dataclasses.replace(params, model=model)).limits
    assert minimum_speed.least_driven(limits) == pytest.approx(-1.0)
    text = minimum_speed.stopping_text(limits)
    assert 'rolls back faster than 1 m/s' in text
    assert '7' not in text
