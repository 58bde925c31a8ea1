"""Marginals are the quantiles and shares of the drives of a group; pairs are compared by draw."""

import math

import numpy as np
import pandas
import pytest

from bags.errors import BagError
from experiments.results import marginals

Z = 1.959964  # of the normal distribution, 95 %


def test_a_share_has_the_interval_of_wilson(table):
    summary = marginals.summarise(table, 'survived', ['controller'])
    row = summary.set_index('controller').loc['b']
    held = table.rows[table.rows['controller'] == 'b']['survived']
    n, p = len(held), held.mean()
    middle = (p + Z**2 / (2 * n)) / (1 + Z**2 / n)
    half = Z / (1 + Z**2 / n) * math.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2))
    assert (row['drives'], row['missing']) == (n, 0)
    assert (row['share'], row['low'], row['high']) == pytest.approx(
        (p, middle - half, middle + half)
    )


def test_numbers_have_quantiles_and_missing_ones_are_counted(table):
    summary = marginals.summarise(table, 'clearance_m', ['controller']).set_index('controller')
    values = table.rows[table.rows['controller'] == 'a']['clearance_m'].dropna()
    assert summary.loc['a', 'missing'] == 1
    assert summary.loc['a', 'drives'] == len(values) + 1
    for name, share in (('q05', 0.05), ('median', 0.5), ('q95', 0.95)):
        assert summary.loc['a', name] == pytest.approx(np.quantile(values, share))


def test_many_numbers_are_grouped_by_equal_counts_and_few_are_kept(table):
    by_speed = marginals.summarise(table, 'survived', ['speed'], bins=4)
    assert len(by_speed) == 4
    assert by_speed['drives'].max() - by_speed['drives'].min() <= 4
    assert by_speed['share'].is_monotonic_decreasing
    assert list(marginals.summarise(table, 'survived', ['run'])['run']) == [1, 2]


def test_every_drive_is_in_one_cell_of_two_columns(table):
    cells = marginals.summarise(table, 'survived', ['speed', 'friction'], bins=3)
    assert len(cells) == 9
    assert cells['drives'].sum() == len(table.rows)


def test_a_constant_difference_is_found_though_draws_differ_far_more(table):
    result = marginals.compare(table, 'clearance_m', ('b', 'a')).iloc[0]
    assert result['mean'] == pytest.approx(0.1, abs=0.003)
    assert result['low'] < 0.1 < result['high'] < 0.105
    assert result['pairs'] == 398  # one drive has no result, one no value
    assert result['greater'] == 398
    swapped = marginals.compare(table, 'clearance_m', ('a', 'b')).iloc[0]
    assert swapped['mean'] == pytest.approx(-result['mean'])
    assert swapped['less'] == 398


def test_equal_outcomes_have_no_difference(table):
    result = marginals.compare(table, 'survived', ('b', 'a'), by=['run'])
    assert list(result['mean']) == [0.0, 0.0]
    assert list(result['greater'] + result['less']) == [0, 0]


def test_repeats_of_a_draw_count_once(table):
    """Twenty copies of every draw must not narrow the interval of the mean."""
    import pandas

    rows = table.rows[(table.rows['run'] == 1) & (table.rows['draw'] > 1)].copy()
    is_b = rows['controller'] == 'b'
    rows.loc[is_b, 'clearance_m'] += np.random.default_rng(1).normal(0.0, 1.0, is_b.sum())
    copies = [rows.assign(run=run) for run in range(1, 21)]
    once = marginals.compare(table._replace(rows=rows), 'clearance_m', ('b', 'a')).iloc[0]
    many = table._replace(rows=pandas.concat(copies, ignore_index=True))
    often = marginals.compare(many, 'clearance_m', ('b', 'a')).iloc[0]
    width, width_often = (one['high'] - one['low'] for one in (once, often))
    assert often['pairs'] == 20 * once['pairs']
    assert width_often == pytest.approx(width, rel=0.1)


def test_the_bootstrap_of_many_values_is_the_normal_interval():
    values = np.random.default_rng(3).exponential(1.0, 2000)
    low, high = marginals.bootstrap_mean(values, np.random.default_rng(0))
    half = Z * values.std() / math.sqrt(len(values))
    assert (low, high) == pytest.approx(
        (values.mean() - half, values.mean() + half), abs=0.15 * half
    )


def test_one_value_has_no_interval():
    assert np.isnan(marginals.bootstrap_mean(np.ones(1), np.random.default_rng(0))).all()


@pytest.mark.parametrize(
    ('pair', 'by', 'what'),
    [
        (('a', 'c'), [], "no drive of 'c'; there are a, b"),
        (('a', 'b'), ['lost_by'], '--by lost_by: goes with --pair only for'),
    ],
)
def test_a_comparison_that_cannot_be_made_is_an_error(table, pair, by, what):
    with pytest.raises(BagError, match=what):
        marginals.compare(table, 'clearance_m', pair, by)


def test_settings_with_the_same_draws_do_not_narrow_the_interval(table):
    one = marginals.compare(table, 'clearance_m', ('b', 'a')).iloc[0]
    copies = [table.rows.assign(gain=gain) for gain in range(4)]
    many = table._replace(
        rows=pandas.concat(copies, ignore_index=True), inputs=('gain', *table.inputs)
    )
    four = marginals.compare(many, 'clearance_m', ('b', 'a')).iloc[0]
    assert four['pairs'] == 4 * one['pairs']
    assert four['high'] - four['low'] == pytest.approx(one['high'] - one['low'], rel=0.2)


def test_where_nothing_is_drawn_runs_are_what_is_resampled(table):
    rows = table.rows[table.rows['draw'] < 20].copy()
    rows['run'] = rows['run'] + 2 * (rows['draw'] % 5)
    undrawn = table._replace(
        rows=rows.drop(columns='draw'), inputs=tuple(n for n in table.inputs if n != 'draw')
    )
    assert undrawn.units(undrawn.rows).nunique() == 10
    rows['draw'] = rows['draw'].where(rows['draw'] < 10)
    assert table.units(rows).nunique() == 10 + rows[rows['draw'].isna()]['run'].nunique()
