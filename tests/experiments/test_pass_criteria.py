"""Expectations of a scenario against the metrics of a run."""

import pytest

from experiments import library, pass_criteria
from scenario_publisher import scenario
from scenario_publisher.expectations import Expectation, Expectations

METRICS = {
    'survived': True,
    'min_v2o_per_obstacle_m': {'1': 0.4, '2': None},
    'peak_sideslip_deg': 12.0,
}


@pytest.mark.parametrize(
    ('expectation', 'measured', 'is_met'),
    [
        (Expectation('survived', value=True), True, True),
        (Expectation('min_v2o_per_obstacle_m.1', at_least=0.5), 0.4, False),
        (Expectation('min_v2o_per_obstacle_m.2', at_least=0.5), None, False),
        (Expectation('min_v2o_per_obstacle_m.3', at_least=0.5), None, False),
        (Expectation('peak_sideslip_deg', at_most=12.0), 12.0, True),
    ],
)
def test_measured_values_are_found_by_their_dotted_names(expectation, measured, is_met):
    (outcome,) = pass_criteria.judge(Expectations([expectation]), METRICS)
    assert (outcome.measured, outcome.is_met) == (measured, is_met)


def test_the_entries_of_the_library_expect_what_there_is():
    """A metric that does not exist: test_mistakes.py."""
    for name in library.entries_of_library():
        pass_criteria.check_names(scenario.load(name).expect, name)
