"""No message ends the scenario node, and what it says obeys the contract."""

import nodes
import pytest
from hypothesis import given, settings
from telling import batches, tell_all

from msgs_yaml import conformance

pytestmark = pytest.mark.ros
DOMAIN = 83
FUZZ = settings.get_profile('fuzz')


@pytest.fixture(params=['lockstep', 'realtime'])
def scenario(request):
    with nodes.running('scenario', request.param, DOMAIN) as bench:
        yield bench


def test_the_scenario_outlives_every_message(scenario, count):
    (heard,) = scenario.ears()
    topic = heard.topic

    @FUZZ
    @given(batches(topic))
    def told(batch):
        tell_all(scenario, topic, batch, count)
        for name, said in scenario.drain():
            assert conformance.check(name, said) == []

    told()
