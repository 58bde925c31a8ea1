"""What README and results say of the paper's claims are the numbers of the rows that are kept."""

from pathlib import Path

import pytest

from experiments import settings_study

ROOT = Path(__file__).parents[2]
MATCHED, LINEAGE = 'frenet_matched', 'frenet_lineage'
CLAIMS = ('unsafe_area', 'sideslip', 'min_speed', 'brake_onset', 'conjunction')


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


def test_readme_says_what_was_fixed_beforehand_and_what_the_drives_show(study, shares):
    text = page('README.md')
    assert len(shares) == 2 * len(CLAIMS)
    assert {share.verdict for share in shares.values()} == {'open'}
    matched = [share for share in shares.values() if share.baseline == MATCHED]
    undetermined = [100 * share.undetermined / share.settings for share in matched]
    percent = f'{min(undetermined):.0f} to {max(undetermined):.0f} %'
    area, sideslip, together = (
        shares[MATCHED, claim] for claim in ('unsafe_area', 'sideslip', 'conjunction')
    )
    for words in (
        f'{study.rules["runs"]["confirmatory"]["count"]:,} settings of them were drawn',
        f'hold in {sideslip.settings} of them',
        f'{percent} of the settings',
        f'in {sideslip.holds} of {sideslip.settings} settings',
        f'in {together.holds} of {together.settings}, and',
        f'keeps {-area.median:.2f} m less distance',
        f'has {-sideslip.median:.1f} deg more sideslip',
    ):
        assert words in text
    assert f'{percent} of them are' in page('docs/results.md')


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


@pytest.mark.parametrize(
    ('claim', 'unit', 'sign', 'between'),
    [
        ('unsafe_area', 'm', 1, '+'),
        ('sideslip', 'deg', -1, '+'),
        ('min_speed', 'm/s', 1, '+'),
        ('brake_onset', 'm earlier', 1, ''),
    ],
)
def test_results_have_every_median_of_mpcc_less_baseline(shares, claim, unit, sign, between):
    """Those of the rows are positive in the direction of the paper: less sideslip."""
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
