"""Drives in process, each driven once for all tests."""

import json
from collections.abc import Mapping
from functools import cache

import pytest
from driven_setups import driven
from fixed_weights import fixed_weights

from experiments import simulation


@pytest.fixture(scope='session')
def drive():
    """Return drive(scenario, controller, settings by role, kph): a Driven.

    With the weights of tests, but where settings name others.
    """

    @cache
    def remembered(scenario, controller, settings, kph):
        speed_mps = None if kph is None else kph / 3.6
        chosen = json.loads(settings)
        own = fixed_weights(controller) | chosen.get('controller', {})
        setup = simulation.prepare(scenario, controller, chosen | {'controller': own}, speed_mps)
        return driven(setup)

    def once(scenario: str, controller: str, settings: Mapping = {}, kph: float | None = None):
        return remembered(scenario, controller, json.dumps(settings, sort_keys=True), kph)

    return once
