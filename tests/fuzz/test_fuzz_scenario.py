"""No message crashes the scenario node, and its messages obey the contract."""

import time

import node_bench
import pytest
from batches import batches, send_all
from example_messages import load_example
from hypothesis import given, settings

from msgs_yaml import conformance
from node_runtime import ros

pytestmark = pytest.mark.ros
FUZZ = settings.get_profile('fuzz')
PATIENCE_S = 60.0
OBSTACLES = '/scenario/obstacles'


@pytest.fixture
def scenario(request):
    with node_bench.running('scenario', request.param) as bench:
        yield bench


def messages_after(scenario, speak):
    """Return the messages of the scenario after `speak()`, at least one."""
    end = time.monotonic() + PATIENCE_S
    while ros.missing_subscriptions(scenario.node, {OBSTACLES: 1}):
        assert time.monotonic() < end, 'no subscription'
        time.sleep(0.01)
    speak()
    while not (messages := scenario.drain()):
        assert time.monotonic() < end, 'no message'
        time.sleep(0.001)
    return messages


def check(messages):
    for name, message in messages:
        assert conformance.check(name, message) == []


@pytest.mark.parametrize('scenario', ['lockstep'], indirect=True)
def test_the_scenario_survives_every_clock(scenario, count):
    (heard,) = scenario.subscriptions()

    @FUZZ
    @given(batches(heard.topic_name))
    def example(batch):
        send_all(scenario, heard.topic_name, batch, count)
        sound = load_example(heard.topic_name)
        check(messages_after(scenario, lambda: heard.callback(sound)))

    example()


@pytest.mark.parametrize('scenario', ['realtime'], indirect=True)
def test_the_scenario_survives_every_start_of_the_run(scenario, count):
    (heard,) = scenario.subscriptions()
    heard.callback(ros.serialize(load_example(heard.topic_name)))  # now there is something to say

    @FUZZ
    @given(batches(heard.topic_name))
    def example(batch):
        send_all(scenario, heard.topic_name, batch, count)
        check(messages_after(scenario, scenario.node.on_timer))

    example()
