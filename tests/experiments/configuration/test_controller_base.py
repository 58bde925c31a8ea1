"""A controller file may hold only what differs from its base, wherever it is."""

import pytest
import yaml

from bags.errors import BagError
from experiments.configuration import inputs, node_config
from msgs_yaml import share
from node_runtime import parameters

SMALL = '/**:\n  ros__parameters:\n    base: {}\n    safety: {{obstacle_m: 0.875}}\n'


@pytest.fixture
def controller_node(tmp_path):
    """Return controller_node(path): the controller of a double lane change."""
    facts = inputs.load_facts('double_lane_change')

    def build(path):
        controller = node_config.find_controller(str(path))
        files = (tmp_path / 'bag', tmp_path / 'run_info')
        nodes = node_config.build_nodes(facts, controller, 'lockstep', *files, {})
        return {node.role: node for node in nodes}['controller']

    return build


@pytest.mark.parametrize('name', ['mpcc.yaml', 'sub/other.yaml', 'other.yaml'])
def test_a_small_file_gives_the_parameters_of_its_base_and_its_own(controller_node, tmp_path, name):
    whole = share.path('mpcc_controller', 'config', 'mpcc.yaml')
    (tmp_path / 'sub').mkdir()
    for other in ('sub/other.yaml', 'other.yaml'):
        (tmp_path / other).write_text(whole.read_text())
    path = tmp_path / 'mine.yaml'
    path.write_text(SMALL.format(name))
    base = whole if name == 'mpcc.yaml' else tmp_path / name

    node = controller_node(path)
    params, _ = inputs.check_parameters([node])['controller']
    expected = parameters.read_file(whole).values | {'safety.obstacle_m': 0.875}
    assert {k: v for k, v in parameters.flatten(params).items() if k in expected} == {
        k: tuple(v) if isinstance(v, list) else v for k, v in expected.items()
    }
    # ROS does not tell the node where its file is
    written = yaml.safe_load(node_config.write_parameter_file(node, tmp_path).read_text())
    assert written['/**']['ros__parameters']['base'] == str(base)
    recorded = node_config.collect_parameters([node], {})['controller']
    assert 'base' not in recorded
    assert expected.items() <= recorded.items()


def test_a_file_without_a_base_writes_none(controller_node, tmp_path):
    node = controller_node('mpcc')
    written = yaml.safe_load(node_config.write_parameter_file(node, tmp_path).read_text())
    assert 'base' not in written['/**']['ros__parameters']


def test_a_base_that_does_not_exist_is_named_before_anything_starts(controller_node, tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text(SMALL.format('mpc.yaml'))
    with pytest.raises(BagError, match=r'mine.yaml:3: base: there is no file mpc.yaml'):
        inputs.check_parameters([controller_node(path)])
