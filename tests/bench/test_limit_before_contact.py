"""The limit before contact: what counts as meeting an obstacle, and the page about it."""

import json
from pathlib import Path
from types import SimpleNamespace

import approach_drives
import limit_before_contact
import numpy as np
import pytest

from experiments import page_block

PAGE = Path(__file__).parents[2] / 'docs/threats.md'
STAMPS = np.arange(6) * 1_000_000
FAR = np.array([5.0, 4.0, 3.0, 2.0, 3.0, 4.0])


@pytest.mark.parametrize(
    ('circle', 'outline', 'sample'),
    [
        (FAR, FAR + 0.3, 3),
        (FAR - 3.5, FAR, 2),  # the circle touches first
        (FAR - 2.5, FAR - 3.5, 2),  # the outline does
        (np.where(FAR > 4.5, np.nan, FAR), FAR, 3),  # an obstacle that appears
    ],
)
def test_an_obstacle_is_met_at_the_first_contact_or_the_nearest_approach(circle, outline, sample):
    driven = SimpleNamespace(motion=SimpleNamespace(stamp_ns=STAMPS))
    series = SimpleNamespace(v2o={1: circle}, outline_gaps={1: outline})
    assert approach_drives.meeting_ns(driven, series, 1) == STAMPS[sample]


def test_the_page_shows_what_was_measured():
    runs = json.loads(limit_before_contact.FILE.read_text())
    _, between, _ = page_block.split(PAGE, limit_before_contact.BLOCK)
    assert between == limit_before_contact.page_text(runs)


def test_a_limit_that_is_reached_before_an_obstacle_is_reached_in_the_whole_drive():
    for run in json.loads(limit_before_contact.FILE.read_text()).values():
        for shares in run['shares'].values():
            first, second, whole = (np.array(shares[name]) for name in limit_before_contact.TITLES)
            assert len(first) == run['settings']
            assert np.all(first <= second)
            assert np.all(second <= whole)
