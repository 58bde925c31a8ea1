"""Node graphs in namespaces: two cars in one ROS domain, isolated. Real Fast DDS."""

import json
from contextlib import ExitStack

import numpy as np
import pytest
from node_graph import NUMERIC, OF_PROCESSES, ROLES, NodeGraph, note_run
from node_ring import NodeRing

from bags.report.comparison import compare_bags
from bags.storage import read
from bags.storage.message_filing import LOSS_RECORD
from msgs_yaml import contract

pytestmark = OF_PROCESSES
SHORT = {'stop.x_m': 15.0, 'stop.armed_after_m': 1.0}  # about a second of driving
CARS = {'/car1': {**SHORT, 'start.speed_mps': 15.0}, '/car2': {**SHORT, 'start.speed_mps': 17.0}}
PLANNED = ('/scenario/obstacles', '/controller/prediction')


@pytest.fixture(scope='module')
def together(domain, tmp_path_factory):
    """The bags of two graphs in one domain at once, by their namespace."""
    folder, graphs = tmp_path_factory.mktemp('together'), {}
    with ExitStack() as both:
        for namespace, plant in CARS.items():
            here = folder / namespace.strip('/')
            here.mkdir()
            graph = graphs[namespace] = both.enter_context(NodeGraph(here, domain, plant=plant))
            graph.namespace = namespace
            note_run(graph.nodes.values(), here, 'straight', f'mpcc_{here.name}')
        for role in ROLES:
            for graph in graphs.values():
                graph.start(role)
        return {namespace: graph.finish() for namespace, graph in graphs.items()}


@pytest.fixture(scope='module', params=CARS)
def pair(request, together, tmp_path_factory):
    """Return (namespace, its bag of `together`, the bag of the same nodes alone, without DDS)."""
    folder = tmp_path_factory.mktemp('alone')
    with NodeRing(folder, 'lockstep', 'straight', plant=CARS[request.param]) as ring:
        alone = ring.finish()
    return request.param, together[request.param], alone


def test_each_node_graph_records_the_same_bits_as_alone(pair):
    _, beside, alone = pair
    ours, theirs = read.columns(beside, NUMERIC), read.columns(alone, NUMERIC)
    for topic in NUMERIC:
        for name, column in ours[topic].items():
            assert column.tobytes() == getattr(theirs[topic], name).tobytes(), f'{topic} {name}'
    for topic in PLANNED:
        ours, theirs = (
            {value.stamp_ns: value for value in read.values(bag, topic)} for bag in (beside, alone)
        )
        assert ours.keys() == theirs.keys(), topic
        for stamp_ns, value in ours.items():
            for field, other in zip(value, theirs[stamp_ns]):
                assert np.array_equal(field, other), topic


def test_a_node_graph_receives_only_its_own_clock_and_health(pair):
    _, beside, alone = pair
    clocks = (dict.fromkeys(read.recording(bag, '/clock').payloads) for bag in (beside, alone))
    assert next(clocks) == next(clocks)
    healths = read.values(beside, '/diagnostics')
    assert len({(health.name, health.stamp_ns) for health in healths}) == len(healths)


def test_nothing_is_lost_beside_another_node_graph(together):
    for bag in together.values():
        for topic, text in bag.records[LOSS_RECORD].items():
            assert json.loads(text)['lost'] in (0, None), f'{bag.path}: {topic}'


def test_a_bag_has_the_names_of_the_contract_and_notes_its_namespace(pair):
    namespace, beside, alone = pair
    assert set(beside.recordings) >= set(contract.load().topics)
    assert beside.run_info['namespace'] == namespace
    assert alone.run_info['namespace'] == '/'


def test_both_bags_can_be_compared(together, tmp_path):
    folders = [bag.path.parent for bag in together.values()]
    compare_bags(folders, tmp_path, force=True)
    compared = json.loads((tmp_path / 'comparison.json').read_text())
    assert set(compared['runs']) == {'mpcc_car1', 'mpcc_car2'}
