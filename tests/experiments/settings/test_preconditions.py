"""Preconditions and claims on rows made by hand."""

import math
from pathlib import Path

import pytest

from experiments.settings import outcomes, plan, preconditions, primaries
from experiments.settings.preconditions import Levels

PREREGISTRATION = Path(__file__).parents[3] / 'paper/settings/settings_study.yaml'
PLAN = plan.rules(PREREGISTRATION.read_text())
GOOD = {
    'setting': 7,
    'S': 0.8,
    'perturbation': 0,
    'error': '',
    'safety_obstacle_m': 0.5,
    'safety_edge_m': 0.4,
    'completed': True,
    'lost': False,
    'v2o_1_m': 0.6,
    'outline_1_m': 0.7,
    'min_v2o_m': 0.6,
    'min_v2e_m': 0.5,
    'min_outline_gap_m': 0.7,
    'outline_edge_m': 0.6,
    'limit_share': 0.97,
    'peak_sideslip_deg': 3.0,
    'brake_onset_planned_at_m': 60.0,
    'min_speed_mps': 18.0,
}
HIT = GOOD | {'v2o_1_m': -0.1, 'outline_1_m': 0.05, 'min_v2o_m': -0.1}


def evaluate(no_ca=HIT, mpcc=GOOD, baseline=GOOD):
    return preconditions.evaluate(PLAN.preconditions, no_ca, mpcc, baseline)


def test_all_conditions_are_met_in_the_picture_of_the_paper():
    assert evaluate() == Levels(True, True, True, True, True)


def test_an_easy_task_fails_the_first_condition_only():
    assert evaluate(no_ca=HIT | {'S': 0.69}) == Levels(False, True, True, True, True)


def test_the_contact_of_the_circle_counts_and_that_of_the_outline_is_told_apart():
    assert preconditions.hits_first(HIT, 'circle')
    assert not preconditions.hits_first(HIT, 'outline')
    assert not evaluate(no_ca=GOOD).P1
    assert preconditions.hits_first(GOOD | {'outline_1_m': -0.01}, 'outline')


@pytest.mark.parametrize(
    'fault',
    [
        {'completed': False},
        {'min_v2o_m': -0.01},
        {'min_v2e_m': -0.01},
        {'lost': True},
    ],
    ids=str,
)
@pytest.mark.parametrize('who', ['mpcc', 'baseline'])
def test_whoever_fails_to_avoid_fails_the_second_condition(who, fault):
    met = evaluate(**{who: GOOD | fault})
    assert not met.P2
    assert met._replace(P2=True) == evaluate()


def test_a_circle_that_touches_is_no_contact_of_the_outline():
    row = GOOD | {'min_v2o_m': -0.01}
    assert preconditions.avoids(row, 'outline')
    assert not preconditions.avoids(row, 'circle')


@pytest.mark.parametrize('gap', ['min_outline_gap_m', 'outline_edge_m'])
def test_an_outline_that_touches_is_no_contact_of_the_circle(gap):
    row = GOOD | {gap: -0.01}
    assert preconditions.avoids(row, 'circle')
    assert not preconditions.avoids(row, 'outline')


@pytest.mark.parametrize('who', ['no_ca', 'mpcc', 'baseline'])
def test_all_three_must_reach_the_limit(who):
    slow = {'no_ca': HIT}.get(who, GOOD) | {'limit_share': 0.94}
    assert not evaluate(**{who: slow}).P3


@pytest.mark.parametrize('missing', [None, math.nan])
@pytest.mark.parametrize('who', ['mpcc', 'baseline'])
def test_both_must_brake(who, missing):
    assert not evaluate(**{who: GOOD | {'brake_onset_planned_at_m': missing}}).P4


def test_a_drive_with_an_error_meets_nothing():
    failed = {'setting': 7, 'S': 0.8, 'error': 'its process was ended'}
    assert evaluate(mpcc=failed) == Levels(True, True, False, False, False)
    assert evaluate(no_ca=failed) == Levels(True, False, True, False, True)


def test_levels_are_nested():
    met = Levels(False, True, True, True, False)
    assert met.reaches('P3', least='P1')
    assert not met.reaches('P3')
    assert not met.reaches('P4', least='P1')


def claims(mpcc=GOOD, baseline=GOOD):
    return primaries.evaluate(PLAN.primaries, mpcc, baseline)


def test_equal_drives_show_no_difference():
    for claim, outcome in claims().items():
        assert not outcome.holds
        assert outcome.difference in ((None,) if claim == 'conjunction' else (0.0,))


PICTURE = GOOD | {
    'min_v2o_m': 0.3,
    'peak_sideslip_deg': 9.0,
    'brake_onset_planned_at_m': 80.0,
    'min_speed_mps': 15.0,
}


def test_the_picture_of_the_paper_holds_with_differences_in_its_direction():
    found = claims(baseline=PICTURE)
    assert all(outcome.holds for outcome in found.values())
    assert found['unsafe_area'].difference == pytest.approx(0.3)  # 0.1 m kept less -0.2 m
    assert found['sideslip'].difference == pytest.approx(6.0)
    assert found['brake_onset'].difference == pytest.approx(20.0)
    assert found['min_speed'].difference == pytest.approx(3.0)


def test_the_opposite_of_the_picture_has_opposite_differences():
    there, back = claims(baseline=PICTURE), claims(mpcc=PICTURE, baseline=GOOD)
    for claim in set(there) - {'conjunction'}:
        assert back[claim].difference == pytest.approx(-there[claim].difference)
        assert not back[claim].holds


def test_a_car_that_never_brakes_has_no_onset_and_decides_no_conjunction():
    found = claims(baseline=PICTURE | {'brake_onset_planned_at_m': None})
    assert found['brake_onset'] == (None, None)
    assert found['conjunction'].holds is None


def test_one_claim_that_fails_decides_the_conjunction():
    calm = PICTURE | {'brake_onset_planned_at_m': None, 'peak_sideslip_deg': 3.0}
    assert claims(baseline=calm)['conjunction'].holds is False


def test_an_intrusion_within_the_slack_is_none():
    slack = PLAN.primaries.unsafe_area.slack_m
    grazing = GOOD | {'min_v2e_m': GOOD['safety_edge_m'] - 0.9 * slack}
    inside = GOOD | {'min_v2e_m': GOOD['safety_edge_m'] - 1.1 * slack}
    assert claims(mpcc=grazing, baseline=inside)['unsafe_area'].holds
    assert not claims(mpcc=grazing, baseline=grazing)['unsafe_area'].holds
    assert not claims(mpcc=inside, baseline=inside)['unsafe_area'].holds


def row(arm, perturbation=0, **changed):
    base = HIT if arm == 'mpcc_no_ca' else GOOD
    return base | {'arm': arm, 'perturbation': perturbation} | changed


def test_outcomes_are_one_row_per_baseline_and_perturbation():
    rows = [row('mpcc_no_ca'), *(row('mpcc', k) for k in range(5))]
    rows += [row('frenet_matched', k, peak_sideslip_deg=9.0 + k) for k in range(5)]
    rows += [row('frenet_lineage', lost=True)]
    found = list(outcomes.build(PLAN, rows))
    assert [(r['baseline'], r['perturbation']) for r in found] == [
        *(('frenet_matched', k) for k in range(5)),
        ('frenet_lineage', 0),
    ]
    assert [r['sideslip.difference'] for r in found[:5]] == [6.0, 7.0, 8.0, 9.0, 10.0]
    assert all(r['P2'] for r in found[:5])
    assert not found[5]['P2']


def test_a_setting_without_contact_counts_at_the_lowest_level():
    (found,) = outcomes.build(PLAN, [GOOD | {'arm': 'mpcc_no_ca'}])
    assert (found['baseline'], found['P0'], found['P1']) == ('', True, False)
    assert 'sideslip.holds' not in found


def test_a_setting_whose_baseline_was_not_driven_counts_at_the_lowest_level():
    (found,) = outcomes.build(PLAN, [row('mpcc_no_ca'), row('mpcc')])
    assert (found['baseline'], found['P1'], found['P2']) == ('', True, False)


def test_a_start_has_conditions_of_its_own():
    rows = [row('mpcc_no_ca'), *(row('mpcc', k) for k in range(5))]
    crashed = {'completed': False, 'brake_onset_planned_at_m': None}
    rows += [row('frenet_matched', k, **(crashed if k == 3 else {})) for k in range(5)]
    found = list(outcomes.build(PLAN, rows))
    assert all(r['P2'] and r['P4'] for r in found)
    assert [r['start.P2'] for r in found] == [True, True, True, False, True]
    assert [r['start.P4'] for r in found] == [True, True, True, False, True]


@pytest.mark.parametrize('is_missing', [True, False])
def test_a_start_without_a_result_of_an_accepted_setting_is_an_unknown_one(is_missing):
    rows = [row('mpcc_no_ca'), *(row('mpcc', k) for k in range(5))]
    rows += [row('frenet_matched', k) for k in range(4)]
    if not is_missing:
        rows.append(row('frenet_matched', 4, error='its process was ended'))
    *_, last = outcomes.build(PLAN, rows)
    assert (last['perturbation'], last['start.P2']) == (4, False)
    assert all(last[f'{claim}.holds'] is None for claim in primaries.CLAIMS)
