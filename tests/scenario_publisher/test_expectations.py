"""`expect:` of scenario files: what is read, and what meets it."""

import pytest

from scenario_publisher.expectations import Expectation

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
