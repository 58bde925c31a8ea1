"""What README and results say of the paper's claims are the numbers of the tables."""

import csv
import json
from pathlib import Path

import pytest

from experiments.statistical_inference import paired_interval, wilson_interval

ROOT = Path(__file__).parents[2]
SETTINGS = ROOT / 'paper/settings'
CLAIMS = ('unsafe_area', 'sideslip', 'min_speed', 'brake_onset', 'conjunction')
MATCHED, LINEAGE = 'frenet_matched', 'frenet_lineage'


def page(name):
    """Return the text of a page with single spaces."""
    return ' '.join((ROOT / name).read_text().split())


def decided(run):
    return json.loads((SETTINGS / run / 'claims.json').read_text())


def claims(run, baseline=MATCHED):
    found = {one['key']: one for one in decided(run)['claims'] if one['baseline'] == baseline}
    return [found[key] for key in CLAIMS]


def accepted(run):
    (row,) = (
        row for row in decided(run)['counts'] if (row['baseline'], row['least']) == (MATCHED, 'P1')
    )
    return row['P3']


def share(one):
    low, high = (100 * end for end in wilson_interval(one['holds'], one['settings']))
    return f'{one["holds"]} of {one["settings"]} ({low:.1f}–{high:.1f} %)'


def test_readme_says_what_was_fixed_beforehand_and_came_out():
    text = page('README.md')
    runs = ('confirmatory', 'repetition')
    first, second = (decided(run)['provenance'] for run in runs)
    assert f'{first["settings"]:,} settings of them were drawn' in text
    assert f'and {second["settings"]:,} of another seed' in text
    assert 'hold in {} and {} of them'.format(*map(accepted, runs)) in text
    for run in (*runs, 'pooled'):
        assert {one['verdict'] for one in claims(run) + claims(run, LINEAGE)} == {'open'}
    undetermined = [100 * one['undetermined'] for one in claims('confirmatory')]
    assert f'{min(undetermined):.0f} to {max(undetermined):.0f} % of the settings' in text
    assert not first['failed_drives']
    assert not second['failed_drives']
    assert f'all of {first["drives"] + second["drives"]:,} drives have a result' in text


def test_readme_says_what_the_same_drives_show():
    text = page('README.md')
    area, sideslip, _, _, together = claims('pooled')
    assert f'in {sideslip["holds"]} of {sideslip["settings"]} settings' in text
    assert f'in {together["holds"]} of {together["settings"]}' in text
    assert f'keeps {-area["median_difference"]:.2f} m less distance' in text
    assert f'has {-sideslip["median_difference"]:.1f} deg more sideslip' in text


def test_results_have_every_share_with_its_interval():
    text = page('docs/results.md')
    for matched, lineage in zip(claims('pooled'), claims('pooled', LINEAGE)):
        assert f'| {share(matched)} | {share(lineage)} |' in text
    area, *_ = claims('pooled')
    settings = area['settings']
    unknown, undetermined = (
        round(settings * area[name]) for name in ('undetermined_by_unknown_starts', 'undetermined')
    )
    assert f'in {unknown} of the {undetermined} that are undetermined' in text


@pytest.mark.parametrize(
    ('place', 'unit', 'digits', 'sign', 'between'),
    [
        (0, 'm', 2, 1, '+'),
        (1, 'deg', 2, -1, '+'),
        (2, 'm/s', 2, 1, '+'),
        (3, 'm earlier', 2, 1, ''),
    ],
)
def test_results_have_every_median_of_mpcc_less_baseline(place, unit, digits, sign, between):
    """Those of the tables are positive in the direction of the paper: less sideslip."""
    cells = []
    for baseline in (MATCHED, LINEAGE):
        one = claims('pooled', baseline)[place]
        low, high = sorted(sign * end for end in one['median_interval'])
        median = sign * one['median_difference']
        cells.append(
            f'{median:{between}.{digits}f} {unit} ({low:+.{digits}f} to {high:+.{digits}f})'
        )
    assert f'| {cells[0]} | {cells[1]} |' in page('docs/results.md')


def test_results_have_who_brakes_later_and_who_alone():
    pairs = json.loads((SETTINGS / 'pooled/braking.json').read_text())['pairs']
    matched, lineage = (
        one | {each['who']: each['settings'] for each in one['who']}
        for one in pairs
        if one['level'] == 'P3'
    )
    wanted = (
        f'10 m *later* in {matched["later"]} of the {matched["both"]} and earlier in '
        f'{matched["earlier"]}; the baseline alone brakes hard in {matched["baseline alone"]} of '
        f'the {matched["settings"]}, the MPCC alone in {matched["MPCC alone"]} (lineage: later in '
        f'{lineage["later"]} of {lineage["both"]}, earlier in {lineage["earlier"]}; '
        f'{lineage["baseline alone"]} and {lineage["MPCC alone"]} of {lineage["settings"]} alone)'
    )
    assert wanted in page('docs/results.md')


def test_results_have_who_avoids_and_what_the_frame_moves():
    text = page('docs/results.md')
    avoidance = json.loads((SETTINGS / 'levels/avoidance.json').read_text())
    cells = []
    for row in avoidance['paired']:
        counts = row['mpcc_alone'], row['baseline_alone'], avoidance['settings']
        low, high = (100 * end for end in paired_interval(*counts))
        difference = 100 * (counts[0] - counts[1]) / counts[2]
        cells.append(f'{difference:+.1f} points ({low:+.1f} to {high:+.1f})')
    assert f'{avoidance["settings"]:,} other settings' in text
    assert f'| {cells[0]} | {cells[1]} |' in text
    with (SETTINGS / 'pooled/causes.csv').open() as file:
        frame = {
            row['claim']: float(row['effect'])
            for row in csv.DictReader(file)
            if row['term'] == 'frame'
        }
    assert f'by {1000 * abs(frame["unsafe_area"]):.0f} mm' in text
    assert f'by {abs(frame["sideslip"]):.2f} deg' in text
