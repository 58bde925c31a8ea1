"""The golden recordings, each read once."""

from functools import cache
from pathlib import Path

import pytest

from bags.storage import read

GOLDEN = Path(__file__).parents[3] / 'bags/reference/double_lane_change'


@pytest.fixture(scope='session')
def golden():
    """Return a function from the name of a controller to its golden bag."""
    return cache(lambda name: read.load(GOLDEN / name))
