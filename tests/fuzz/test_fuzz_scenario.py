"""No message crashes the scenario node, and its messages obey the contract."""

import time

import node_bench
import pytest
from batches import BATCH, batches, send_all
from diagnostic_msgs.msg import KeyValue
from example_messages import load_example
from hypothesis import given, settings
from hypothesis import strategies as st

from msgs_yaml import conformance
from node_runtime import ros

pytestmark = pytest.mark.ros
FUZZ = settings.get_profile('fuzz')
PATIENCE_S = 60.0
OBSTACLES, TELEMETRY = '/scenario/obstacles', '/diagnostics'
INSTANTS = ('soon', '', 'nan', 'inf', '-inf', '1e12', 'True', '0', '-1', '1', '9' * 400)
instants = st.one_of(
    st.sampled_from(INSTANTS), st.integers().map(str), st.floats().map(str), st.text(max_size=20)
)


@pytest.fixture
def scenario(request):
    with node_bench.running('scenario', request.param) as bench:
        yield bench


def health_of_plant(text):
    """Return the serialised health of a plant that says when its run began."""
    message = load_example(TELEMETRY)
    message.status[0].values.append(KeyValue(key='run_began_ns', value=text))
    return ros.serialize(message)


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
def test_the_scenario_survives_all_telemetry(scenario, count):
    (heard,) = scenario.subscriptions()
    assert heard.topic_name == TELEMETRY
    heard.callback(health_of_plant('1'))  # from now on there is something to say

    @FUZZ
    @given(batches(TELEMETRY), st.lists(instants, min_size=BATCH, max_size=BATCH))
    def example(batch, began):
        send_all(scenario, TELEMETRY, batch, count)
        check(messages_after(scenario, scenario.node.on_timer))
        for text in began:
            heard.callback(health_of_plant(text))
            count(TELEMETRY)
            check(messages_after(scenario, scenario.node.on_timer))

    example()
