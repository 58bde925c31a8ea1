"""The entries of the library come to what their files expect, driven by mpcc_road."""

import pytest

from bags.evaluation import metrics
from experiments import pass_criteria, simulation
from experiments.library import catalogue
from scenario_publisher import scenario

QUICK = ('pop_up_late', 'oncoming_car')
ENTRIES = catalogue.entries_of_library()


def unmet(name):
    """Drive an entry once; return the expectations that are not met, with what was measured."""
    setup = simulation.prepare(name, 'mpcc_road')
    values = metrics.compute_metrics(simulation.drive(setup))
    outcomes = pass_criteria.judge(setup.scn.expect, values)
    assert outcomes
    return {o.expectation.metric: o.measured for o in outcomes if not o.is_met}


@pytest.mark.parametrize('name', QUICK)
def test_an_entry_comes_to_what_its_file_expects(name):
    assert unmet(name) == {}


@pytest.mark.slow
@pytest.mark.parametrize('name', [name for name in ENTRIES if name not in QUICK])
def test_every_other_entry_comes_to_what_its_file_expects(name):
    assert unmet(name) == {}


def test_every_expectation_is_of_a_metric_that_exists():
    for name in ENTRIES:
        pass_criteria.check_names(scenario.load(name).expect, name)
