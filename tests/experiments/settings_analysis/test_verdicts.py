"""Verdicts on synthetic settings whose truth is known."""

import numpy as np
import pandas as pd
import pytest

from experiments.settings_analysis import verdicts
from experiments.settings_analysis.verdicts import IN_PART, NOT, OPEN, REPRODUCED, Outcomes

MARGIN = 0.5
RULE = verdicts.Rule(holds_from=0.5, rare_below=0.05, confidence=0.95)


def make_outcomes(n, holds, undetermined=0, difference=1.0):
    """Return outcomes: the first `holds` hold, the last `undetermined` are undetermined."""
    order = np.arange(n)
    return Outcomes(order < holds, order >= n - undetermined, np.full(n, difference))


def decide_all(claims):
    """Return {claim: (decision, adjusted p-value, verdict)} of {claim: (outcomes, margin)}."""
    decisions = {
        key: verdicts.decide(given, margin, RULE) for key, (given, margin) in claims.items()
    }
    judged = verdicts.judge(decisions, RULE)
    return {key: (made, *judged[key]) for key, made in decisions.items()}


def decide_one(given, margin=MARGIN):
    (result,) = decide_all({'claim': (given, margin)}).values()
    return result


def make_pairs(differences, threshold=1.0):
    """Return pairs from {setting: differences by perturbation}; None is a missing value."""
    rows = [
        {
            'setting': setting,
            'perturbation': k,
            'difference': np.nan if value is None else value,
            'holds': np.nan if value is None else float(value >= threshold),
        }
        for setting, values in differences.items()
        for k, value in enumerate(values)
    ]
    return pd.DataFrame(rows)


def test_a_setting_is_undetermined_where_its_starts_disagree_and_strictly_beyond_the_margin():
    pairs = make_pairs({1: [2.0, 2.4], 2: [2.0, 2.6], 3: [0.9, 1.1], 4: [3.0, None]})
    table = verdicts.summarise(pairs, MARGIN)
    assert table['undetermined'].to_dict() == {1: False, 2: False, 3: True, 4: True}
    assert table['undetermined_strictly'].to_dict() == {1: False, 2: True, 3: True, 4: True}
    assert verdicts.outcomes(table).undetermined.tolist() == [False, False, True, True]
    strictly = verdicts.outcomes(table, is_strict=True)
    assert strictly.undetermined.tolist() == [False, True, True, True]
    assert table['difference'].to_dict() == pytest.approx({1: 2.2, 2: 2.3, 3: 1.0, 4: 3.0})


def test_a_setting_holds_in_most_of_its_perturbations():
    pairs = make_pairs({1: [2, 2, 2, 0, 0], 2: [2, 2, 0, 0, 0], 3: [None] * 5})
    table = verdicts.summarise(pairs, MARGIN)
    assert table['holds'].to_dict() == {1: True, 2: False}  # of 3 nothing is known


def test_without_a_margin_disagreement_is_undetermined():
    pairs = make_pairs({1: [2, 2, 0], 2: [2, 2, 2], 3: [0, 0, 0]})
    table = verdicts.summarise(pairs, None)
    assert table['undetermined'].to_dict() == {1: True, 2: False, 3: False}


@pytest.mark.parametrize('margin', [MARGIN, None])
def test_a_start_that_does_not_tell_leaves_its_setting_undetermined(margin):
    table = verdicts.summarise(make_pairs({1: [2, 2, 2, 2, None], 2: [2] * 5}), margin)
    assert table['undetermined'].to_dict() == {1: True, 2: False}
    assert table['unknown'].to_dict() == {1: True, 2: False}


@pytest.mark.parametrize(
    ('holds', 'undetermined', 'expected'),
    [
        (180, 0, REPRODUCED),
        (60, 0, IN_PART),
        (0, 0, NOT),
        (2, 0, NOT),
        (104, 0, OPEN),
        (12, 0, OPEN),
        # 180 of 200 hold, but half of the settings might go either way
        (180, 100, OPEN),
        (60, 100, OPEN),
        # a few that might go either way do not matter
        (180, 5, REPRODUCED),
        (0, 2, NOT),
        (60, 5, IN_PART),
    ],
)
def test_the_verdict_on_a_known_share(holds, undetermined, expected):
    assert decide_one(make_outcomes(200, holds, undetermined))[2] == expected


def test_without_settings_nothing_is_decided():
    decision, p_value, verdict = decide_one(make_outcomes(0, 0))
    assert verdict == OPEN
    assert decision.share is None
    assert p_value == 1.0


def test_a_claim_without_margin_has_no_difference():
    decision, _, _ = decide_one(make_outcomes(20, 20), None)
    assert decision.median is None
    assert decision.relation is None


def test_a_family_of_claims_needs_more_evidence():
    """What decides a claim alone may be open among five."""
    given = make_outcomes(100, 61)
    alone = decide_one(given)
    five = decide_all(dict.fromkeys('abcde', (given, MARGIN)))
    assert alone[2] == REPRODUCED
    assert {verdict for _, _, verdict in five.values()} == {OPEN}
    assert [p_value for _, p_value, _ in five.values()] == pytest.approx([5 * alone[1]] * 5)


def test_a_share_at_a_threshold_is_rarely_decided():
    """In five claims at once, the probability of any wrong verdict stays at most 5 %."""
    rng = np.random.default_rng(6)
    wrong = 0
    for _ in range(15):
        claims = {}
        for key in 'abcde':
            holds = rng.random(150) < RULE.holds_from
            claims[key] = Outcomes(holds, np.zeros(150, bool), np.where(holds, 1.0, 0.0)), None
        verdicts_ = [made[2] for made in decide_all(claims).values()]
        wrong += REPRODUCED in verdicts_
    assert wrong <= 4  # 0.75 expected; more than 4 in 1 of 1,000 repeats of this test
