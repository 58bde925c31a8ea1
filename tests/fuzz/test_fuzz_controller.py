"""No message ends the controller, and none makes it say something that must not be said."""

import nodes
import pytest
from hypothesis import given, settings
from telling import batches, tell_all

from msgs_yaml import conformance, stamp

pytestmark = pytest.mark.ros
DOMAIN = 81
START_NS = 1_000_000_000
FUZZ = settings.get_profile('fuzz')
CONTROLLER = (
    '/scenario/reference',
    '/scenario/road_edges',
    '/scenario/obstacles',
    '/vehicle/actuators',
    '/vehicle/odometry',
)


@pytest.fixture(scope='module', params=['lockstep', 'realtime'])
def controller(request):
    with nodes.running('controller', request.param, DOMAIN) as bench:
        nodes.tell_facts(bench.node, START_NS)
        yield bench


@pytest.mark.parametrize('topic', CONTROLLER)
def test_the_controller_outlives_every_message_and_answers_the_next_state(controller, topic, count):
    now = {'ns': START_NS}

    @FUZZ
    @given(batches(topic))
    def told(batch):
        tell_all(controller, topic, batch, count)
        answer = controller.node.answer
        assert answer is None or conformance.check('/controller/command', answer) == []
        if controller.mode == 'lockstep':
            now['ns'] += nodes.TICK_NS
            nodes.tell_facts(controller.node, now['ns'])
            nodes.tell_tick(controller.node, now['ns'])
            answer = controller.node.answer
            assert stamp.to_ns(answer.header.stamp) == now['ns']
            assert conformance.check('/controller/command', answer) == []
        controller.drain()

    told()
