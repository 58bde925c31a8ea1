"""No message ends the scenario node, and what it says obeys the contract."""

import time

import hostile
import nodes
import pytest
from diagnostic_msgs.msg import KeyValue
from hypothesis import given, settings
from hypothesis import strategies as st
from telling import BATCH, batches, tell_all

from msgs_yaml import conformance
from node_runtime import ros

pytestmark = pytest.mark.ros
FUZZ = settings.get_profile('fuzz')
PATIENCE_S = 10.0
OBSTACLES, TELEMETRY = '/scenario/obstacles', '/diagnostics'
INSTANTS = ('soon', '', 'nan', 'inf', '-inf', '1e12', 'True', '0', '-1', '1', '9' * 400)
instants = st.one_of(
    st.sampled_from(INSTANTS), st.integers().map(str), st.floats().map(str), st.text(max_size=20)
)


@pytest.fixture
def scenario(request):
    with nodes.running('scenario', request.param) as bench:
        yield bench


def plant_began(text):
    """Return the serialised health of a plant that says when its run began."""
    message = hostile.example(TELEMETRY)
    message.status[0].values.append(KeyValue(key='run_began_ns', value=text))
    return ros.serialize(message)


def heard_after(scenario, speak):
    """Return what the scenario says when it is made to speak; at least that is to be heard."""
    end = time.monotonic() + PATIENCE_S
    while ros.missing_subscriptions(scenario.node, {OBSTACLES: 1}):
        assert time.monotonic() < end, 'nobody listens'
        time.sleep(0.01)
    speak()
    while not (said := scenario.drain()):
        assert time.monotonic() < end, 'nothing heard'
        time.sleep(0.001)
    return said


def check(said):
    for name, message in said:
        assert conformance.check(name, message) == []


@pytest.mark.parametrize('scenario', ['lockstep'], indirect=True)
def test_the_scenario_outlives_every_clock(scenario, count):
    (heard,) = scenario.ears()

    @FUZZ
    @given(batches(heard.topic_name))
    def told(batch):
        tell_all(scenario, heard.topic_name, batch, count)
        sound = hostile.example(heard.topic_name)
        check(heard_after(scenario, lambda: heard.callback(sound)))

    told()


@pytest.mark.parametrize('scenario', ['realtime'], indirect=True)
def test_the_scenario_outlives_all_telemetry(scenario, count):
    (heard,) = scenario.ears()
    assert heard.topic_name == TELEMETRY
    heard.callback(plant_began('1'))  # from now on there is something to say

    @FUZZ
    @given(batches(TELEMETRY), st.lists(instants, min_size=BATCH, max_size=BATCH))
    def told(batch, began):
        tell_all(scenario, TELEMETRY, batch, count)
        check(heard_after(scenario, scenario.node.on_timer))
        for text in began:
            heard.callback(plant_began(text))
            count(TELEMETRY)
            check(heard_after(scenario, scenario.node.on_timer))

    told()
