"""What README and results say of the paper's claims are the numbers of the rows that are kept."""

from pathlib import Path

import pytest

from experiments import settings_study
from experiments.tuned_study import analysis, picture, plan, run

ROOT = Path(__file__).parents[2]
MATCHED, LINEAGE = 'frenet_matched', 'frenet_lineage'
ALL = ('avoided', 'all')
UNITS = {'unsafe_area': 'm', 'sideslip': 'deg', 'min_speed': 'm/s', 'brake_onset': 'm earlier'}
CLAIMS = (*UNITS, 'conjunction')


def page(name):
    """Return the text of a page with single spaces."""
    return ' '.join((ROOT / name).read_text().split())


@pytest.fixture(scope='module')
def study():
    return settings_study.read(ROOT / 'paper/settings')


@pytest.fixture(scope='module')
def shares(study):
    rows = settings_study.shares(study).itertuples()
    return {(share.baseline, share.claim): share for share in rows}


@pytest.fixture(scope='module')
def tuned():
    """Return verdicts, and estimates by name, quantity and group, of the tuned controllers."""
    folder = ROOT / 'paper/study'
    results = analysis.analyse(plan.read(folder), run.read(folder, 'drives'))
    rows = (row for rows in results[2:] for row in rows)
    return results.verdicts, {(row.name, row.what, row.group): row.estimate for row in rows}


def percent(estimate, unit, sign=''):
    """Return a share as pages have it, with its interval."""
    mean, low, high = (f'{100 * value:{sign}.1f}' for value in estimate[:3])
    return f'{mean} {unit} ({low} to {high})'


def test_results_have_the_verdicts_on_tuned_controllers(tuned):
    gap, balance = tuned[0]
    assert (gap.text, balance.text) == ('baseline better', 'baseline better')
    assert [item.confidence for item in (gap, balance)] == pytest.approx([0.95, 0.975])
    for item, level in ((gap, ''), (balance, ', of 97.5 %')):
        shown = percent(item.estimate, 'points', '+')
        cells = f'| {shown}{level}, margin {100 * item.margin:.0f} | **the baseline is better**'
        assert cells in page('docs/results.md')


def test_readme_and_results_have_what_tuned_controllers_avoid(tuned):
    readme, results = page('README.md'), page('docs/results.md')
    avoided = {name: row for (name, what, of), row in tuned[1].items() if (what, of) == ALL}
    for name in ('mpcc', 'frenet', 'mpcc_heading', MATCHED, LINEAGE, 'mpcc_shipped'):
        assert f'| {percent(avoided[name], "%")} |' in results
    pairs = ['mpcc - frenet', 'mpcc_heading - frenet', 'mpcc_heading - mpcc']
    for pair in (*pairs[:2], f'mpcc - {MATCHED}', f'mpcc - {LINEAGE}'):
        assert f'{percent(avoided[pair], "points", "+")} |' in results
    for name in ('mpcc', 'frenet', 'mpcc_heading', LINEAGE, 'mpcc_shipped', 'frenet_shipped'):
        assert f'{100 * avoided[name].mean:.0f} %' in readme
    assert all(percent(avoided[pair], 'points') in readme for pair in pairs)


def test_results_have_limits_losses_and_effects_of_tuned_controllers(tuned):
    results = page('docs/results.md')
    rows = tuned[1]
    ratios = [row for (_, what, _), row in rows.items() if what == 'ratio']
    least, most = (f(row.mean for row in ratios) for f in (min, max))
    low, high = min(row.low for row in ratios), max(row.high for row in ratios)
    assert f'a ratio of {least:.2f} to {most:.2f} (the four' in results
    assert f'intervals lie within {low:.2f} to {high:.2f})' in results
    for cause in (analysis.LATENCY, analysis.KNOWN_LATENCY):
        for arm in ('mpcc', 'frenet'):
            assert percent(rows[arm, 'avoidance lost', cause], 'points') in results
    for factor in ('frame', 'heading', 'shape'):
        mean, low, high = rows[factor, 'peak_sideslip_deg', 'effect'][:3]
        assert f'{mean:+.2f} deg ({low:+.2f} to {high:+.2f})' in results


def test_readme_and_results_have_how_rare_the_picture_is():
    folder = ROOT / 'paper/study'
    rules, drives = plan.read(folder)['picture'], run.read(folder, 'picture')
    distances = picture.distances(drives, rules)
    draws = (drives['arm'] == 'mpcc').sum()
    assert f'{(distances == 0).sum()} of {draws:,} draws' in page('README.md')
    assert f'safety distance in {len(distances)}, and in one of these' in page('docs/results.md')
    demand = next(row for row in picture.marginals(drives, rules) if row.name == 'S')
    before, after = demand.prior[1], demand.posterior[1]
    assert f'(median {after:.2f} instead of {before:.2f})' in page('docs/results.md')
    assert f'({after:.2f} of the limit in the median)' in page('README.md')


def test_results_say_how_many_settings_are_undetermined(shares):
    assert len(shares) == 2 * len(CLAIMS)
    assert {share.verdict for share in shares.values()} == {'open'}
    matched = [share for share in shares.values() if share.baseline == MATCHED]
    undetermined = [100 * share.undetermined / share.settings for share in matched]
    text = f'{min(undetermined):.0f} to {max(undetermined):.0f} % of them are'
    assert text in page('docs/results.md')
    together = shares[MATCHED, 'conjunction']
    assert together.holds == 0
    assert f'no setting of {together.settings} showed all four' in page('README.md')


def test_results_have_every_share_with_its_interval(shares):
    text = page('docs/results.md')
    for claim in CLAIMS:
        cells = [
            f'{share.holds} of {share.settings} ({100 * share.low:.1f}–{100 * share.high:.1f} %)'
            for share in (shares[baseline, claim] for baseline in (MATCHED, LINEAGE))
        ]
        assert f'| {" | ".join(cells)} |' in text
    area = shares[MATCHED, 'unsafe_area']
    assert f'in {area.silent} of the {area.undetermined} that are undetermined' in text


@pytest.mark.parametrize(('claim', 'unit'), UNITS.items())
def test_results_have_every_median_of_mpcc_less_baseline(shares, claim, unit):
    """Those of the rows are positive in the direction of the paper: less sideslip."""
    sign, between = -1 if claim == 'sideslip' else 1, '' if claim == 'brake_onset' else '+'
    cells = []
    for share in (shares[baseline, claim] for baseline in (MATCHED, LINEAGE)):
        low, high = sorted((sign * share.median_low, sign * share.median_high))
        cells.append(f'{sign * share.median:{between}.2f} {unit} ({low:+.2f} to {high:+.2f})')
    assert f'| {cells[0]} | {cells[1]} |' in page('docs/results.md')


def test_results_have_who_brakes_later_and_who_alone(study):
    matched, lineage = settings_study.braking(study).itertuples()
    assert (matched.baseline, lineage.baseline) == (MATCHED, LINEAGE)
    assert (
        f'10 m *later* in {matched.later} of the {matched.both} and earlier in {matched.earlier}; '
        f'the baseline alone brakes hard in {matched.baseline_alone} of the {matched.settings}, '
        f'the MPCC alone in {matched.mpcc_alone} (lineage: later in {lineage.later} of '
        f'{lineage.both}, earlier in {lineage.earlier}; {lineage.baseline_alone} and '
        f'{lineage.mpcc_alone} of {lineage.settings} alone)'
    ) in page('docs/results.md')
