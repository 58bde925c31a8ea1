"""Drives in process, each driven once for all tests."""

import json
from collections.abc import Mapping
from functools import cache

import pytest
from driven_setups import driven, prepare


@pytest.fixture(scope='session')
def drive():
    """Return drive(scenario, controller, settings by role, kph): a Driven, see `prepare`."""

    @cache
    def remembered(scenario, controller, settings, kph):
        speed_mps = None if kph is None else kph / 3.6
        return driven(prepare(scenario, controller, json.loads(settings), speed_mps))

    def once(scenario: str, controller: str, settings: Mapping = {}, kph: float | None = None):
        return remembered(scenario, controller, json.dumps(settings, sort_keys=True), kph)

    return once
