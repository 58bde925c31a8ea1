"""Shares of cleared runs over the speed: known ones are found, rising ones are noticed."""

import argparse
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bags.errors import BagError
from experiments.commands import study
from experiments.study import limit, success_curve, variants
from experiments.study.metric_distributions import Sweep

SPEEDS = limit.SPEEDS_KPH
RUNS = 20


class Cliff:
    """Runs that clear below a speed."""

    def __init__(self, make_record, kph, jobs=2):
        self.make_record, self.kph, self.jobs, self.driven = make_record, kph, jobs, 0

    def run(self, specs, label, done_before=0, total=None):
        self.driven += len(specs)
        return [
            self.make_record(completed=spec.speed_kph <= self.kph)._replace(spec=spec)
            for spec in specs
        ]


def run_part(part, runner, out, **given):
    options = {'tuned': [], 'row': [], 'quick': False, 'runs': None, **given}
    return study.run_part(argparse.Namespace(part=part, out=out, **options), runner, {})


def logistic(middle=100.0, width=8.0):
    """Return the probability of clearing each speed."""
    return 1 / (1 + np.exp((np.array(SPEEDS) - middle) / width))


def draw(shares, seed, runs=RUNS):
    return success_curve.fit_curve(
        'c', SPEEDS, np.random.default_rng(seed).binomial(runs, shares), runs
    )


def test_the_interval_holds_the_speed_of_a_known_share_in_most_draws():
    """The truth is where the known shares, linear between the speeds, fall below the level."""
    shares = logistic()
    for k, level in enumerate(success_curve.LEVELS):
        truth = success_curve.find_crossing(SPEEDS, shares, level)
        found = [draw(shares, seed).crossings[k] for seed in range(20)]
        held = sum(one.low <= truth <= one.high for one in found)
        assert held >= 18
        assert np.median([one.kph for one in found]) == pytest.approx(truth, abs=5.0)
        assert np.mean([one.high - one.low for one in found]) < 45.0


def test_more_runs_narrow_the_interval():
    few, many = (draw(logistic(), 3, runs).crossings[1] for runs in (10, 1000))
    assert many.high - many.low < 0.3 * (few.high - few.low)
    assert many.kph == pytest.approx(100.0, abs=1.5)


def test_shares_that_fall_with_the_speed_are_rarely_called_uneven():
    uneven = [draw(logistic(), seed).monotone_p < limit.UNEVEN for seed in range(30)]
    assert sum(uneven) <= 4


def test_a_share_that_rises_again_is_noticed():
    """As observed: a row that fails at 100 km/h and clears most runs at 140 km/h."""
    shares = np.where(np.array(SPEEDS) == 100.0, 0.2, 0.85)
    assert sum(draw(shares, seed).monotone_p < limit.UNEVEN for seed in range(10)) >= 9


def test_beyond_the_speeds_a_crossing_has_no_number():
    always = success_curve.fit_curve('c', SPEEDS, [RUNS] * len(SPEEDS), RUNS)
    never = success_curve.fit_curve('c', SPEEDS, [0] * len(SPEEDS), RUNS)
    for crossing in always.crossings:
        assert crossing.kph == crossing.high == np.inf
        # 20 of 20 at the last speed do not show that the share is above 90 %
        assert np.isfinite(crossing.low) == (crossing.level == 0.9)
    for crossing in never.crossings:
        assert crossing.kph == crossing.low == -np.inf


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(0, RUNS), min_size=10, max_size=10))
def test_the_crossing_is_within_its_interval_and_a_lower_level_is_crossed_later(cleared):
    curve = success_curve.fit_curve('c', SPEEDS, cleared, RUNS)
    for one in curve.crossings:
        assert one.low <= one.kph <= one.high
    high, low = curve.crossings
    assert high.kph <= low.kph
    assert np.all(np.diff(curve.monotone) <= 1e-12)
    assert 0.0 <= curve.monotone_p <= 1.0
    falls = np.all(np.diff(cleared) <= 0)
    assert not falls or curve.monotone_p == 1.0


def test_every_speed_is_driven_with_every_draw(make_record, tmp_path):
    drives = Cliff(make_record, 75.0)
    files = limit.run(drives, tmp_path, Sweep(['mpcc', 'frenet'], 4, limit.SPEEDS_KPH))
    assert drives.driven == 2 * 4 * len(SPEEDS)
    document = json.loads((tmp_path / 'limit.json').read_text())
    for row in document['rows']:
        cleared = [one['cleared'] for one in row['cleared'].values()]
        assert cleared == [4, 4, 4, 0, 0, 0, 0, 0, 0, 0]
        assert 70.0 < row['falls_below_0.5']['kph'] < 80.0
        assert row['falls_below_0.5']['low_kph'] >= 60.0
    assert '75 [' in (tmp_path / 'limit.md').read_text()
    assert {path.suffix for path in files} == {'.md', '.csv', '.json', '.png', '.svg'}
    assert all(path.stat().st_size > 300 for path in files)


def test_only_the_requested_rows_are_simulated(make_record, tmp_path):
    rows = ['frenet no heading', 'mpcc']
    run_part('limit', Cliff(make_record, 75.0), tmp_path, runs=2, row=[*rows, 'mpcc'])
    document = json.loads((tmp_path / 'limit.json').read_text())
    assert [row['controller'] for row in document['rows']] == rows
    assert document['provenance']['switched'] == {
        'frenet no heading': {'formulation.heading': False}
    }
    with pytest.raises(BagError, match=r"no row 'mpc'; there are mpcc,"):
        run_part('limit', Cliff(make_record, 75.0), tmp_path, runs=2, row=['mpc'])
    with pytest.raises(BagError, match='--row is for the limits only, not for ablation'):
        run_part('ablation', Cliff(make_record, 75.0), tmp_path, runs=2, row=['mpcc'])


@pytest.mark.parametrize(('quick', 'switched'), [(False, True), (True, False)])
def test_every_switched_factor_has_its_limit_and_its_settings_in_the_provenance(
    make_record, tmp_path, quick, switched
):
    drives = Cliff(make_record, 75.0)
    run_part('limit', drives, tmp_path, runs=2, quick=quick)
    document = json.loads((tmp_path / 'limit.json').read_text())
    names = [row['controller'] for row in document['rows']]
    assert len(set(names)) == len(names)
    assert set(variants.CONTROLLERS) <= set(names)
    found = document['provenance']
    assert bool(found['switched']) is switched
    assert set(found['roles']) | set(found['switched']) == set(names)
    if switched:
        assert found['switched']['frenet gaussian'] == {'formulation.priority': 'gaussian'}
        assert variants.BASE not in names, 'it is the MPCC'
