"""`expect:` of scenario files: what is read, what is refused, and what meets it."""

import pytest

from scenario_publisher.expectations import Expectation
from scenario_publisher.scenario import ScenarioError

EXPECT = """
expect:
  survived: true
  min_v2o_per_obstacle_m.1: {at_least: 0.2}
  peak_sideslip_deg: {at_least: 1, at_most: 15.0}
"""


def test_expectations_are_read_in_their_order(make, text):
    assert make(text + EXPECT).expect == (
        Expectation('survived', value=True),
        Expectation('min_v2o_per_obstacle_m.1', at_least=0.2),
        Expectation('peak_sideslip_deg', at_least=1.0, at_most=15.0),
    )
    assert make(text).expect == ()


@pytest.mark.parametrize(
    ('block', 'message'),
    [
        ('survived: maybe', 'allowed true, false, or a block of at_least and at_most'),
        ('ticks: 3', 'allowed true, false, or a block'),
        ('ticks: {}', 'is empty; allowed at_least, at_most or both'),
        ('ticks: {at_last: 3}', 'at_last: unknown key; did you mean'),
        ('ticks: {at_least: yes}', 'must be a number'),
        ('ticks: {at_least: .nan}', 'must be finite'),
        ('ticks: {at_least: 3, at_most: 2}', 'at_least 3 is above at_most 2'),
        ('No Metric: true', 'is no name of a metric'),
    ],
)
def test_mistakes_are_refused_with_their_line(make, text, block, message):
    with pytest.raises(ScenarioError, match=message) as caught:
        make(f'{text}expect:\n  {block}\n')
    line = text.count('\n') + 2
    assert str(caught.value).startswith(f'bend.yaml:{line}: expect.')


@pytest.mark.parametrize(
    ('expectation', 'measured', 'met'),
    [
        (Expectation('a', value=True), True, True),
        (Expectation('a', value=False), True, False),
        (Expectation('a', value=True), None, False),
        # a number is no yes
        (Expectation('a', value=True), 1, False),
        (Expectation('a', at_least=0.2), 0.2, True),
        (Expectation('a', at_least=0.2), 0.19, False),
        (Expectation('a', at_most=2.0), 2.1, False),
        (Expectation('a', at_least=0.0, at_most=2.0), 1, True),
        # no obstacle has no gap: what is missing meets no bound
        (Expectation('a', at_least=0.0), None, False),
        (Expectation('a', at_least=0.0), 'slid', False),
    ],
)
def test_what_meets_an_expectation(expectation, measured, met):
    assert expectation.is_met_by(measured) is met
