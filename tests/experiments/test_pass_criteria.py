"""Expectations of a scenario against the metrics of a run."""

import pytest

from bags.errors import BagError
from experiments import pass_criteria
from scenario_publisher.expectations import Expectation, Expectations

METRICS = {
    'survived': True,
    'min_v2o_per_obstacle_m': {'1': 0.4, '2': None},
    'peak_sideslip_deg': 12.0,
}


def judge(*expect):
    outcomes = pass_criteria.judge(Expectations(expect), METRICS)
    return [(outcome.measured, outcome.is_met) for outcome in outcomes]


def test_measured_values_are_found_by_their_dotted_names():
    assert judge(
        Expectation('survived', value=True),
        Expectation('min_v2o_per_obstacle_m.1', at_least=0.5),
        Expectation('min_v2o_per_obstacle_m.2', at_least=0.5),
        Expectation('min_v2o_per_obstacle_m.3', at_least=0.5),
        Expectation('peak_sideslip_deg', at_most=12.0),
    ) == [(True, True), (0.4, False), (None, False), (None, False), (12.0, True)]


def test_a_metric_that_does_not_exist_is_refused_with_the_closest_name():
    expect = Expectations([Expectation('survives', value=True)])
    with pytest.raises(BagError, match=r'slalom: expect.survives: no such metric.*survived'):
        pass_criteria.check_names(expect, 'slalom')
    pass_criteria.check_names(Expectations([Expectation('survived', value=True)]), 'slalom')
