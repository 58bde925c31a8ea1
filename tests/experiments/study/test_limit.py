"""Bisection finds a known cliff, and stops a probe as soon as it is decided."""

import argparse
import json
import math

import pytest

from bags.errors import BagError
from experiments.commands import study
from experiments.study import limit, run_spec, variants

VARIANT = variants.Variant('mpcc', 'mpcc')


class Cliff:
    """Drives that clear below a speed, and below another one except for the worst grips."""

    def __init__(self, make_record, kph, jobs=2):
        self.make_record, self.kph, self.jobs, self.driven = make_record, kph, jobs, 0

    def run(self, specs, label, done_before, total):
        self.driven += len(specs)
        return [self.make_record(completed=spec.speed_kph <= self.kph) for spec in specs]


def run_part(part, runner, out, **given):
    options = {'tuned': [], 'row': [], 'quick': False, 'runs': None, **given}
    return study.run_part(argparse.Namespace(part=part, out=out, **options), runner, {})


def draws(runs=20):
    return run_spec.draw_runs(runs, speed_kph=0.0)


@pytest.mark.parametrize('kph', [50.2, 71.3, 75.0, 139.9])
def test_the_limit_is_the_cliff_to_the_step(make_record, kph):
    found = limit.find_limit(Cliff(make_record, kph), VARIANT, draws())
    assert found.speed_kph == math.floor(kph / limit.STEP_KPH) * limit.STEP_KPH


def test_beyond_the_range_the_limit_is_its_end_or_nothing(make_record):
    assert (
        limit.find_limit(Cliff(make_record, 200.0), VARIANT, draws()).speed_kph == limit.FASTEST_KPH
    )
    assert limit.find_limit(Cliff(make_record, 40.0), VARIANT, draws()).speed_kph is None


def test_a_probe_ends_when_the_share_cannot_be_reached_any_more(make_record):
    drives = Cliff(make_record, 60.0)
    assert limit.probe_speed(drives, VARIANT, 70.0, draws(20)) == (70.0, 0, 2, False)
    assert limit.probe_speed(drives, VARIANT, 50.0, draws(20)) == (50.0, 20, 20, True)


@pytest.mark.parametrize(('failures', 'holds'), [(1, True), (2, False)])
def test_19_of_20_are_enough_and_18_are_not(make_record, failures, holds):
    class Some(Cliff):
        def run(self, specs, label, done_before, total):
            self.driven += len(specs)
            return [self.make_record(collided=spec.tolerance in worst) for spec in specs]

    worst = {draw.tolerance for draw in draws()[-failures:]}
    assert limit.probe_speed(Some(make_record, 0.0), VARIANT, 70.0, draws()).holds is holds


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
