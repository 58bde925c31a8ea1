"""Thinning keeps what a reader looks for: extremes, gaps, both ends."""

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from bags.report import interactive_panels

VALUES = arrays.arrays(
    float,
    st.integers(1, 400),
    elements=st.one_of(st.floats(-1e6, 1e6), st.just(np.nan)),
)


@given(VALUES, st.integers(1, 40))
def test_extremes_ends_and_order_survive(values, bins):
    kept = interactive_panels.decimate(values, bins)
    assert np.all(np.diff(kept) > 0)
    assert kept[0] == 0
    assert kept[-1] == len(values) - 1
    assert len(kept) <= max(len(values) if len(values) <= 3 * bins + 2 else 0, 3 * bins + 2)
    if not np.isnan(values).all():
        assert np.nanmax(values[kept]) == np.nanmax(values)
        assert np.nanmin(values[kept]) == np.nanmin(values)


@given(VALUES, st.integers(1, 40))
def test_a_gap_stays_a_gap_in_its_stretch(values, bins):
    kept = interactive_panels.decimate(values, bins)
    bounds = np.linspace(0, len(values), bins + 1).astype(int)
    for first, after in itertools.pairwise(bounds):
        inside = kept[(kept >= first) & (kept < after)]
        assert np.isnan(values[first:after]).any() == np.isnan(values[inside]).any()


def test_a_needle_of_one_sample_in_a_minute_is_drawn():
    values = np.sin(np.arange(60_000) / 1000.0)
    values[31_417] = 7.0
    kept = interactive_panels.decimate(values, 600)
    assert 31_417 in kept
    assert len(kept) <= 1802


def test_the_line_through_what_is_kept_covers_the_band_of_every_stretch():
    rng = np.random.default_rng(7)
    values = rng.normal(size=10_000)
    kept = interactive_panels.decimate(values, 100)
    for stretch in np.split(np.arange(10_000), 100):
        inside = values[np.intersect1d(kept, stretch)]
        assert (inside.min(), inside.max()) == (values[stretch].min(), values[stretch].max())
