"""The golden recordings, each read once, and changes to them."""

from functools import cache
from pathlib import Path

import pytest

from bags.storage import read
from experiments.commands.golden import DRIVES

REFERENCE = Path(__file__).parents[3] / 'bags/reference'
GOLDEN = REFERENCE / 'double_lane_change'
FOLDERS = {
    name: REFERENCE / scenario / name
    for scenario, controllers in DRIVES.items()
    for name in controllers
}


@pytest.fixture(scope='session')
def golden():
    """Return a function from the name of a controller to its golden bag."""
    return cache(lambda name: read.load(FOLDERS[name]))


@pytest.fixture(scope='session')
def mpcc(golden):
    return golden('mpcc')


def in_mode(bag, mode):
    """Return a bag that says it was recorded in another mode."""
    return bag._replace(records=bag.records | {'run': bag.run_info | {'mode': mode}})


def with_columns(bag, topic, **columns):
    """Return a bag with other columns of one topic."""
    recording = bag.recordings[topic]._replace(**columns)
    return bag._replace(recordings=bag.recordings | {topic: recording})
