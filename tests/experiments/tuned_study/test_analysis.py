"""The estimands and rules of the study of tuned controllers, on tables whose laws are known."""

import math

import numpy as np
import pandas as pd
import pytest
import synthetic
from scipy.stats import ttest_1samp
from synthetic import PLAN

from bags.errors import BagError
from experiments.statistical_inference import Estimate, estimate, holm_levels
from experiments.tuned_study import analysis, report
from experiments.tuned_study.analysis import decide, stop_rule, verdict

RULES = PLAN['confirmatory']


def only(rows, **fields):
    """Return the row with these fields."""
    (row,) = [row for row in rows if all(getattr(row, k) == v for k, v in fields.items())]
    return row


def test_interval_and_p_are_those_of_the_t_test():
    values = [0.01, -0.03, 0.05, 0.02, 0.04]
    test = ttest_1samp(values, 0.0)
    result = estimate([*values, math.nan], 0.975)
    assert (result.low, result.high) == pytest.approx(tuple(test.confidence_interval(0.975)))
    assert (result.p, result.units) == (pytest.approx(test.pvalue), 5)
    assert math.isnan(estimate([0.1]).low)
    assert (estimate([0.0, 0.0]).p, estimate([0.1, 0.1]).p) == (1.0, 0.0)


@pytest.mark.parametrize(
    ('low', 'high', 'text', 'more'),
    [
        (0.06, 0.12, 'MPCC better', 0),
        (0.01, 0.07, 'MPCC better', 0),
        (0.01, 0.04, 'MPCC better, by less than 5 points', 0),
        (-0.12, -0.06, 'baseline better', 0),
        (-0.04, -0.01, 'baseline better, by less than 5 points', 0),
        (-0.02, 0.03, 'equivalent', 0),
        (-0.05, 0.05, 'equivalent', 0),
        (0.0, 0.04, 'equivalent', 0),
        (-0.02, 0.08, 'open', 60),  # twice as wide as the margin: 20 (2^2 - 1)
        (-0.06, 0.02, 'open', 32),  # 20 (1.6^2 - 1) = 31.2
        (math.nan, math.nan, 'open', 0),
    ],
)
def test_the_verdict_follows_from_interval_and_margin(low, high, text, more):
    assert verdict(Estimate((low + high) / 2, low, high, 20), 0.05) == (text, more)


def test_holms_levels_reject_what_his_procedure_rejects():
    """The published example of en.wikipedia.org/wiki/Holm-Bonferroni_method: H1 and H4 rejected.

    In order 0.005 < 0.0125 and 0.01 < 0.0167 are rejected, 0.03 > 0.025 ends the procedure.
    """
    p = [0.01, 0.04, 0.03, 0.005]
    levels = holm_levels(p)
    assert levels == pytest.approx([0.05 / 3, 0.025, 0.025, 0.0125])
    assert [value < level for value, level in zip(p, levels)] == [True, False, False, True]
    assert holm_levels([math.nan, 0.01]) == pytest.approx([0.05, 0.025])


def test_the_smaller_p_has_the_wider_level_and_lets_the_other_have_95_percent():
    sure, unsure = [0.10, 0.11, 0.12, 0.10], [0.01, 0.05, -0.02, 0.03]
    gap, balance = decide(sure, unsure, RULES)
    assert (gap.confidence, balance.confidence) == pytest.approx((0.975, 0.95))
    assert (gap.text, balance.estimate) == ('MPCC better', estimate(unsure, 0.95))
    assert [item.confidence for item in decide(unsure, unsure, RULES)] == pytest.approx([0.975] * 2)


@pytest.mark.parametrize(
    ('replicates', 'widths', 'stops'),
    [
        (11, (0.01, 0.01), False),
        (12, (0.05, 0.10), True),
        (12, (0.051, 0.10), False),
        (12, (0.05, 0.101), False),
        (12, (math.nan, 0.05), False),
        (20, (0.3, 0.3), True),
    ],
)
def test_the_study_stops_by_widths_and_number_alone(replicates, widths, stops):
    assert stop_rule(replicates, widths, PLAN['stop']).startswith('stop') == stops


def drives(avoided, values):
    index = pd.MultiIndex.from_product([[1], range(len(avoided))], names=['replicate', 'task'])
    return pd.DataFrame({'avoided': avoided, 'peak_sideslip_deg': values}, index=index)


def test_the_win_balance_by_hand():
    """A crash is behind any sideslip, two crashes tie, and so does less than the margin."""
    nan = math.nan
    first = drives(
        [True, True, True, False, True, False, True], [1.0, 2.0, 2.0, 0.1, 9.0, 1.0, nan]
    )
    second = drives([True, True, True, True, False, False, True], [1.5, 2.4, 1.0, 9.0, 0.1, 9.0, 1])
    result = analysis.pairwise(first, second, 'peak_sideslip_deg', 0.5)
    assert result.tolist() == [1, 0, -1, -1, 1, 0, 0]


def test_the_balance_is_the_sum_of_what_avoidance_and_what_both_avoided_make_of_it():
    results = analysis.analyse(PLAN, synthetic.study(synthetic.judged(3, 100)))
    for what in analysis.QUANTITIES:
        whole, *parts = (
            only(results.balances, what=what, group=group).estimate.mean
            for group in ('balance', 'by avoidance', 'where both avoid')
        )
        assert whole == pytest.approx(sum(parts))


def test_the_gap_is_the_mean_over_replicates_of_paired_differences():
    table = synthetic.judged(4, 100, starts=1)
    result = analysis.analyse(PLAN, synthetic.study(table))
    own = table[table['start'] == 0].groupby(['arm', 'replicate'])['avoided'].mean()
    by_hand = own['mpcc'] - own['frenet']
    gap = only(result.gaps, group='all').estimate
    assert gap == pytest.approx(estimate(by_hand))
    assert {row.name for row in result.unsteady} == {'mpcc', 'frenet'}
    lacking = table.drop(table[(table['arm'] == 'mpcc') & (table['task'] == 3)].index)
    with pytest.raises(BagError, match='same tasks'):
        analysis.analyse(PLAN, synthetic.study(lacking))


def test_a_limit_demand_outside_the_tasks_is_not_extrapolated():
    S = np.linspace(0.2, 0.9, 400)
    rng = np.random.default_rng(7)
    for limit in (0.1, 2.0):
        avoided = rng.random(400) < 1 / (1 + (S / limit) ** 4)
        assert math.isnan(analysis.limit_demand(S, avoided, synthetic.SPAN))
    for avoided in (S > 0.5, S > 2.0, S < 2.0):  # rises, never, always
        assert math.isnan(analysis.limit_demand(S, avoided, synthetic.SPAN))
    assert analysis.limit_demand(S, S < 0.5, synthetic.SPAN) == pytest.approx(0.5, abs=0.01)
    rows = list(analysis._limits(synthetic.judged(2, 200, {'mpcc': 0.8, 'frenet': 3.0})))
    assert 'S90 not within' in only(rows, name='mpcc / frenet', group='0 ms').note


def test_avoidance_lost_is_that_of_the_law():
    table = synthetic.judged(12, 400)
    rng = np.random.default_rng(8)
    error, unknown = table['friction_error'], table['latency_ms'].where(~table['compensated'], 0)
    lost = 0.10 * error.clip(lower=0) / 0.05 - 0.04 * error.clip(upper=0) / 0.05
    share = 0.9 - lost - 0.08 * unknown / 25 - 0.02 * table['compensated'] - 0.02 * table['stratum']
    table['avoided'] = rng.random(len(table)) < share
    rows = list(analysis._losses(table))
    for group, size in (
        *((analysis.HIGH, 0.10), (analysis.LOW, 0.04)),
        *((analysis.LATENCY, 0.08), (analysis.KNOWN_LATENCY, 0.02)),
    ):
        for arm, expected in (('mpcc', size), ('frenet', size), ('mpcc - frenet', 0.0)):
            row = only(rows, name=arm, group=group)
            assert row.estimate.mean == pytest.approx(expected, abs=0.04)
            assert row.estimate.units == 12


def test_effects_of_factors_are_those_of_the_law_within_complete_tasks():
    table = synthetic.factorial({(0,): 0.8, (3,): -0.5, (0, 3): 0.3}, noise=0.05)
    table.loc[(table['task'] == 4) & (table['arm'] == 'factorial:0110'), 'avoided'] = False
    rows = [row for row in analysis._effects(table) if row.what == 'peak_sideslip_deg']
    expected = {'frame': 0.8, 'shape': -0.5, 'frame x shape': 0.3}
    assert len(rows) == 10
    for row in rows:
        assert row.estimate.mean == pytest.approx(expected.get(row.name, 0.0), abs=0.02)
        assert (row.note, row.estimate.units) == ('87 of 90 tasks', 3)
    alone = [row.estimate.units for row in analysis._effects(table[table['replicate'] == 1])]
    assert set(alone) == {29}


def test_the_typical_replicate_is_nearest_to_the_median_of_the_logarithms():
    plan = {'search': {'ranges': {'a': [1.0, 1e4], 'b': [1.0, 10.0], 'c': [1.0, 2.0]}}}
    tuned = pd.DataFrame(
        {
            'replicate': [1, 2, 3, 1],
            'arm': ['mpcc', 'mpcc', 'mpcc', 'frenet'],
            'a': [10.0, 100.0, 1000.0, 1.0],
            'b': [2.0, 8.0, 3.0, 1.0],
            'c': [math.nan, math.nan, math.nan, 1.5],
        }
    )
    # shares 0.25 0.3, 0.5 0.9, 0.75 0.48; median 0.5 0.48
    weights = report.typical(plan, tuned, 'mpcc')
    assert (weights.name, weights.to_dict()) == (3, {'a': 1000.0, 'b': 3.0})
