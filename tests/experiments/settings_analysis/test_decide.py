"""The decisions on a made-up study whose answers are known, and their files."""

import dataclasses
import json

import pandas as pd
import pytest
from synthetic_study import make_study

from experiments.settings import arms, outcomes
from experiments.settings_analysis import decide, decision_report, study_tables, verdicts
from experiments.settings_analysis.verdicts import IN_PART, NOT, REPRODUCED


@pytest.fixture(scope='module')
def study():
    return make_study(120)


@pytest.fixture(scope='module')
def results(study):
    return decide.decide(study, explained=['brake_onset'])


def primary(results, claim, baseline=arms.MATCHED):
    (found,) = (
        one
        for one in results.judged
        if one.primary and one.claim == claim and one.baseline == baseline
    )
    return found


def test_what_holds_in_every_setting_is_reproduced(results):
    for claim in ('unsafe_area', 'sideslip'):
        one = primary(results, claim)
        assert one.verdict == REPRODUCED
        assert one.decision.holds == one.decision.settings == 120
    assert primary(results, 'sideslip').decision.median == pytest.approx(6.0)


def test_what_holds_in_none_is_not_reproduced(results):
    speed = primary(results, 'min_speed')
    assert speed.verdict == NOT
    assert speed.decision.relation == 'equivalent'
    assert primary(results, 'conjunction').verdict == NOT
    assert primary(results, 'sideslip', arms.LINEAGE).verdict == NOT


def test_what_depends_on_a_dimension_holds_in_part(study, results):
    onset = primary(results, 'brake_onset')
    tolerance = study_tables.dimensions(study)['velocity_tolerance_mps']
    assert onset.decision.holds == (tolerance < 6.0).sum()
    # a share near one half is what the thresholds leave open
    assert onset.verdict in (IN_PART, 'open')
    drivers = results.drivers[arms.MATCHED, 'brake_onset']
    assert drivers.drivers[0].dimension == 'velocity_tolerance_mps'
    assert decide.driver_names(drivers)[0] == 'velocity_tolerance_mps'


def test_the_factor_that_makes_the_difference_is_found(results):
    effects = {effect.term: effect for effect in results.effects['sideslip']}
    assert effects['heading'].mean == pytest.approx(2.0)
    assert decide.cause_names(results.effects['sideslip']) == ['heading']
    assert decide.cause_names(results.effects['min_speed']) == []


def test_the_levels_count_settings(study, results):
    matched = [row for row in results.counts if row['baseline'] == arms.MATCHED]
    assert [row['least'] for row in matched] == ['P0', 'P1']
    for row in matched:
        assert row['P4'] == row['P3'] == 120


def test_a_counterexample_contradicts_the_verdict(study, results):
    onset = primary(results, 'brake_onset')
    number = decide.counterexample(onset)
    wanted = onset.decision.share <= 0.5
    assert onset.table['holds'][number] == wanted
    assert decide.counterexample(primary(results, 'unsafe_area')) is None


def test_the_files_tell_the_same(tmp_path, study, results):
    files = decision_report.write(study, results, tmp_path)
    assert all(path.stat().st_size for path in files)
    claims = json.loads((tmp_path / 'claims.json').read_text())['claims']
    assert len(claims) == 10  # five claims, two versions of the baseline
    by_key = {(one['key'], one['baseline']): one for one in claims}
    sideslip = by_key['sideslip', arms.MATCHED]
    assert sideslip['verdict'] == REPRODUCED
    assert sideslip['causes'] == ['heading']
    assert sideslip['margin'] == study.plan.primaries.sideslip.margin
    onset = by_key['brake_onset', arms.MATCHED]
    assert onset['counterexample']['command'].endswith(
        f'--number {onset["counterexample"]["setting"]} --seed {study.seed}'
    )
    table = pd.read_csv(tmp_path / 'verdicts.csv')
    primaries = table[table['primary'] & (table['baseline'] == arms.MATCHED)]
    assert set(primaries['claim']) == set(decide.PAPER)
    assert {path.suffix for path in files} == {'.json', '.md', '.csv', '.png', '.svg'}


@pytest.mark.parametrize(('asked', 'is_short'), [(120, False), (121, True)])
def test_the_report_says_where_fewer_settings_were_accepted_than_asked_for(
    study, results, asked, is_short
):
    decision = dataclasses.replace(study.plan.decision, least_settings=asked)
    study = study._replace(plan=dataclasses.replace(study.plan, decision=decision))
    text = decision_report.verdict_text(study, results)
    assert ('Fewer settings than asked for' in text) == is_short


def test_with_another_first_condition_the_verdicts_are_those_at_this_one(study):
    decision = dataclasses.replace(study.plan.decision, from_level='P0')
    near = study._replace(plan=dataclasses.replace(study.plan, decision=decision))
    assert {one.least for one in decide.decide(near, explained=[]).judged if one.primary} == {'P0'}


def test_a_start_just_below_the_limit_tells_of_the_claim_all_the_same(study):
    """Preconditions are those of the undisturbed start."""
    rows = study.drives.to_dict('records')
    for row in rows:
        if row['setting'] == 5 and row['perturbation'] == 2 and row['arm'] == arms.MATCHED:
            row['limit_share'] = 0.948
    built = pd.DataFrame(list(outcomes.build(study.plan, rows)))
    own = built[(built['baseline'] == arms.MATCHED) & (built['setting'] == 5)]
    assert own['start.P3'].tolist() == [True, True, False, True, True]
    pairs = study_tables.pairs(own, 'sideslip', 'P3')
    assert pairs['holds'].notna().all()


@pytest.mark.parametrize(
    ('change', 'at_P3'),
    [
        ({'completed': False}, True),  # with another result than the other starts
        ({'brake_onset_planned_at_m': None}, False),
        ({'error': 'its process was ended'}, True),
    ],
)
def test_a_start_that_does_not_tell_makes_its_setting_undetermined(study, change, at_P3):
    """From the rows of the drives to the settings of a verdict."""
    rows = study.drives.to_dict('records')
    (changed,) = (
        row
        for row in rows
        if (row['setting'], row['arm'], row['perturbation']) == (5, arms.MATCHED, 2)
    )
    changed |= change
    built = pd.DataFrame(list(outcomes.build(study.plan, rows)))
    own = built[built['baseline'] == arms.MATCHED]
    for claim, level, expected in (
        ('brake_onset', 'P4', True),
        ('conjunction', 'P4', True),
        ('sideslip', 'P3', at_P3),
        ('sideslip', 'P2', False),  # where the unperturbed start alone counts
    ):
        margin = study_tables.margin(study.plan, claim)
        table = verdicts.summarise(study_tables.pairs(own, claim, level), margin)
        assert len(table) == 120
        assert table['undetermined'][5] == expected
        assert table['undetermined'].sum() == expected


def test_a_screened_study_says_nothing_below_the_level_that_it_was_screened_for(tmp_path, study):
    screened = study._replace(notes=study.notes | {'screened': 'true'})
    found = decide.decide(screened, explained=['sideslip'])
    assert {one.level for one in found.judged} == {'P3', 'P4'}
    assert all(row['P1'] is None and row['P2'] is None for row in found.counts)
    assert {row['P3'] for row in found.counts} == {120}
    assert not found.drivers
    files = decision_report.write(screened, found, tmp_path)
    assert not [path for path in files if path.name.startswith('map_')]
    assert json.loads((tmp_path / 'claims.json').read_text())['provenance']['screened'] is True
    assert 'The study is screened' in (tmp_path / 'verdicts.md').read_text()


def test_tables_that_were_not_made_as_planned_are_flagged(tmp_path, study, results):
    assert [text.partition(':')[0] for text in study.departures] == ['seed', 'settings', 'screened']
    decision_report.write(study, results, tmp_path)
    assert '**Not the preregistered run**: seed: 1,' in (tmp_path / 'verdicts.md').read_text()
    origin = json.loads((tmp_path / 'claims.json').read_text())['provenance']
    assert origin['departures'] == study.departures
    run = dataclasses.replace(study.plan.runs.levels, seed=1, count=120, screened=False)
    runs = dataclasses.replace(study.plan.runs, levels=run)
    planned = study._replace(plan=dataclasses.replace(study.plan, runs=runs))
    assert (planned.run, planned.departures) == ('levels', [])


def test_onsets_near_the_start_are_counted_apart(tmp_path, study, results):
    assert study_tables.censored_onsets(study) == (0, 360)
    near = study.drives.copy()
    chosen = (near['setting'] < 3) & (near['arm'] == arms.MPCC)
    near.loc[chosen, 'brake_onset_planned_at_m'] = 5.9  # 0.3 s at 20 m/s are 6 m
    changed = study._replace(drives=near)
    assert study_tables.censored_onsets(changed) == (3, 360)
    text = decision_report.verdict_text(changed, results)
    assert '3 of 360 onsets of braking lie in the first 0.3 s' in text


def test_settings_with_a_crashed_combination_count_for_avoidance_only(study):
    drives = study.drives.copy()
    crashed = (drives['setting'] == 3) & (drives['arm'] == arms.COMBINATIONS[7])
    drives.loc[crashed, 'completed'] = False
    drives.loc[crashed, 'peak_sideslip_deg'] = 30.0
    missing = (drives['setting'] == 4) & (drives['arm'] == arms.COMBINATIONS[9])
    effects = decide.decide(study._replace(drives=drives[~missing]), explained=[]).effects
    assert {effect.settings for effect in effects['sideslip']} == {10}  # of 12
    assert effects['sideslip'][4].mean == pytest.approx(2.0)
    (heading,) = (effect for effect in effects['avoidance'] if effect.term == 'heading')
    assert heading.settings == 11
    assert heading.mean == pytest.approx(-1 / 16 / 11)


def test_who_brakes_is_counted_and_the_conjunction_judged_where_both_do(study, results):
    assert {one.level for one in results.judged if one.claim == 'conjunction'} == {'P4'}
    drives = study.drives.copy()
    for arm, first, last in ((arms.MPCC, 0, 3), (arms.MATCHED, 2, 6)):
        chosen = (drives['arm'] == arm) & drives['setting'].between(first, last - 1)
        drives.loc[chosen, 'brake_onset_planned_at_m'] = None
    changed = study._replace(drives=drives)
    counts = study_tables.braking(changed, arms.MATCHED, 'P3')
    assert counts == {'both': 114, 'MPCC alone': 3, 'baseline alone': 2, 'none': 1}
    text = decision_report.verdict_text(changed, results)
    assert 'Which of the two cars brakes hard' in text


def test_one_version_of_the_baseline_is_confirmatory(study, results):
    entries = decide.claim_entries(study, results)
    confirmatory = {entry['baseline'] for entry in entries if entry['confirmatory']}
    assert confirmatory == {arms.MATCHED}
    text = decision_report.verdict_text(study, results)
    assert '## frenet_matched, confirmatory' in text
    assert '## frenet_lineage, exploratory' in text


def test_each_claim_is_told_by_stratum(study, results):
    one = primary(results, 'brake_onset')
    counts = decide.by_stratum(study, one)
    ends = study.plan.strata.S
    drawn = study_tables.dimensions(study)
    for (held, count), low, high in zip(counts, ends, ends[1:], strict=False):
        own = drawn[(drawn['S'] >= low) & (drawn['S'] < high)]
        assert (held, count) == ((own['velocity_tolerance_mps'] < 6.0).sum(), len(own))
    assert len(counts) == len(ends) - 1
    assert sum(count for _, count in counts) == 120
    assert '| 0.7 to 0.9 |' in decision_report.verdict_text(study, results)
