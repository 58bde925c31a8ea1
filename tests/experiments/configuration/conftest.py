"""The nodes of a run, as any command would build them."""

import pytest

from experiments.configuration import inputs, node_config, set_option


@pytest.fixture
def build(tmp_path):
    """Return build(setting, ..., scenario=, controller=, scn=, given=): nodes by their role."""

    def build_nodes(*settings, scenario='double_lane_change', controller='mpcc', **more):
        scn = more.get('scn') or inputs.load_scenario(str(scenario))
        chosen = node_config.find_controller(str(controller), programs=True)
        given = more.get('given') or (set_option.parse_overrides(settings),)
        nodes = inputs.build_nodes(scn, str(scenario), chosen, *given)
        return {node.role: node for node in nodes}

    return build_nodes


@pytest.fixture
def recorded():
    """Return recorded(nodes): the parameters by role that a run of these nodes records."""

    def record(nodes):
        read = inputs.check_parameters(nodes.values())
        return node_config.collect_parameters(nodes.values(), inputs.file_values(read))

    return record
