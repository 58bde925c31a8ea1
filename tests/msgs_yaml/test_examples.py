"""The examples are complete messages: they obey the contract and can be decoded."""

import numpy as np
import pytest
from example_messages import fill, load_example

from msgs_yaml import conformance, contract, decode, share
from msgs_yaml.types import Obstacle
from node_runtime import ros

TOPICS = sorted(contract.load().topics)
DECODED = [name for name in TOPICS if not contract.load().topics[name].on_request]


def decoder(topic):
    name = topic.rsplit('/', 1)[1]
    return decode.health if name == 'diagnostics' else getattr(decode, name)


@pytest.mark.parametrize('topic', TOPICS)
def test_every_topic_has_an_example_that_obeys_the_contract(topic):
    assert conformance.check(topic, load_example(topic)) == []


@pytest.mark.parametrize('topic', DECODED)
def test_every_example_can_be_decoded(topic):
    decoder(topic)(load_example(topic))


@pytest.mark.parametrize('topic', TOPICS)
def test_the_comment_of_every_example_names_its_topic(topic):
    name = topic.strip('/').replace('/', '-')
    head = share.path('msgs_yaml', 'examples', f'{name}.yaml').read_text().split('\n\n')[0]
    assert f'{topic} {contract.load().topics[topic].type} ' in head


def test_every_example_is_of_a_topic():
    names = {path.stem for path in share.path('msgs_yaml', 'examples').iterdir()}
    assert names == {topic.strip('/').replace('/', '-') for topic in TOPICS}


def test_the_values_of_the_examples_are_those_of_their_comments():
    state = decode.odometry(load_example('/vehicle/odometry'))
    assert state.psi == pytest.approx(0.1, abs=1e-12)
    path = decode.reference(load_example('/scenario/reference'))
    speed = np.diff(path.X) / np.diff(path.t)
    assert speed.tolist() == [20.0, 20.0]
    seen = decode.obstacles(load_example('/scenario/obstacles')).items
    assert seen == (Obstacle(1, 50.0, 0.5, 0.5, 0.0, 0.0), Obstacle(2, 90.0, 2.0, 0.8, -5.0, 0.0))
    assert decode.command(load_example('/controller/command')).Fxf == -3200.0
    assert decode.clock(load_example('/clock')) == 1_050_000_000
    assert decode.run_start(load_example('/vehicle/run_start')) == 12_500_000_000
    assert decode.why(load_example('/controller/why')).values['solver.iterations'] == 7


def test_the_setter_of_these_tests_is_strict():
    message = ros.message_type('/vehicle/odometry')()
    with pytest.raises(KeyError):
        fill(message, {'hedaer': {}})
    with pytest.raises(AssertionError):
        fill(message, {'child_frame_id': 3})
    set_once = fill(message, {'twist': {'twist': {'linear': {'x': 2.0}}}})
    assert set_once.twist.twist.linear.x == 2.0
