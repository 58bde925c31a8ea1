"""Node graphs in namespaces: several cars in one ROS domain, isolated. Real Fast DDS."""

import json
from contextlib import ExitStack

import numpy as np
import pytest
from node_graph import NUMERIC, ROLES, NodeGraph

from bags.report.comparison import compare_bags
from bags.storage import read
from bags.storage.message_loss import LOSS_RECORD
from experiments.configuration import inputs, node_config
from experiments.run import processes
from msgs_yaml import contract
from node_runtime import provenance

pytestmark = pytest.mark.usefixtures('domain')
SHORT = {'stop.x_m': 15.0, 'stop.armed_after_m': 1.0}  # about a second of driving
CARS = {'/car1': {**SHORT, 'start.speed_mps': 15.0}, '/car2': {**SHORT, 'start.speed_mps': 17.0}}
EQUAL = ('/scenario/reference', '/scenario/road_edges', '/scenario/obstacles')
PLANNED = '/controller/prediction'


def make(folder, domain, plant, namespace=''):
    folder.mkdir()
    graph = NodeGraph(folder, domain, plant=plant)
    graph.namespace = namespace
    facts = inputs.load_facts('straight')
    read = inputs.check_parameters(graph.nodes.values())
    parameters = node_config.collect_parameters(graph.nodes.values(), inputs.file_values(read))
    noted = provenance.describe_run(
        facts.name, facts.text, f'mpcc_{folder.name}', 'lockstep', parameters
    )
    (folder / node_config.RUN_INFO_FILE).write_text(json.dumps(noted))
    return graph


def drive(graphs):
    """Start every node of every graph, wait for the plants; return the bags."""
    for role in ROLES:
        for graph in graphs:
            graph.start(role)
    for graph in graphs:
        assert graph.wait('plant') == 0, graph.log('plant')
    # the last state is answered, too
    for graph in graphs:
        processes.stop([graph.running['controller'], graph.running['scenario']])
    return [graph.stop_recording() for graph in graphs]


@pytest.fixture(scope='module')
def together(domain, tmp_path_factory):
    """The bags of two graphs in one domain at once, by their namespace."""
    folder = tmp_path_factory.mktemp('together')
    with ExitStack() as both:
        graphs = [
            both.enter_context(make(folder / namespace.strip('/'), domain, plant, namespace))
            for namespace, plant in CARS.items()
        ]
        return dict(zip(CARS, drive(graphs)))


@pytest.fixture(scope='module', params=CARS)
def pair(request, domain, together, tmp_path_factory):
    """Return (namespace, its bag of `together`, the bag of the same graph alone in the root)."""
    folder = tmp_path_factory.mktemp('alone')
    with make(folder / 'graph', domain, CARS[request.param]) as graph:
        (alone,) = drive([graph])
    return request.param, together[request.param], alone


def changes(bag, topic):
    """Return the messages of a topic that are not the one before, byte by byte."""
    payloads = read.recording(bag, topic).payloads
    return [data for data, before in zip(payloads, [None, *payloads]) if data != before]


def test_each_node_graph_records_the_same_bits_as_alone_in_the_root(pair):
    _, beside, alone = pair
    ours, theirs = read.columns(beside, NUMERIC), read.columns(alone, NUMERIC)
    for topic in NUMERIC:
        for name, column in ours[topic].items():
            assert column.tobytes() == getattr(theirs[topic], name).tobytes(), f'{topic} {name}'


def test_scenario_and_plans_are_those_of_its_own_node_graph(pair):
    _, beside, alone = pair
    for topic in (*EQUAL, PLANNED):
        ours, theirs = read.values(beside, topic), read.values(alone, topic)
        # the first state is repeated until it is answered: how often depends on the wall clock
        ours, theirs = ({one.stamp_ns: one for one in found} for found in (ours, theirs))
        assert ours.keys() == theirs.keys(), topic
        for stamp_ns, one in ours.items():
            for field, other in zip(one, theirs[stamp_ns]):
                assert np.array_equal(field, other), topic


def test_a_node_graph_receives_only_its_own_clock_and_health(pair):
    _, beside, alone = pair
    assert changes(beside, '/clock') == changes(alone, '/clock')
    healths = read.values(beside, '/diagnostics')
    assert len({(one.name, one.stamp_ns) for one in healths}) == len(healths)


def test_nothing_is_lost_beside_another_node_graph(together):
    for bag in together.values():
        for topic, text in bag.records[LOSS_RECORD].items():
            assert json.loads(text)['lost'] in (0, None), f'{bag.path}: {topic}'


def test_a_bag_has_the_names_of_the_contract_and_notes_its_namespace(pair):
    namespace, beside, alone = pair
    assert set(beside.recordings) == set(alone.recordings) >= set(contract.load().topics)
    assert beside.run_info['namespace'] == namespace
    assert alone.run_info['namespace'] == '/'


def test_both_bags_can_be_compared(together, tmp_path):
    folders = [bag.path.parent for bag in together.values()]
    compare_bags(folders, tmp_path, force=True)
    compared = json.loads((tmp_path / 'comparison.json').read_text())
    assert set(compared['runs']) == {'mpcc_car1', 'mpcc_car2'}
