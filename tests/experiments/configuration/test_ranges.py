"""Every node accepts the range of a scenario: friction, speed and time at their bounds."""

import pytest
import yaml

from bags.errors import BagError
from experiments.configuration import inputs, node_config
from node_runtime.parameters import ROAD_FRICTION, RUN_TIME, SPEED
from scenario_publisher import scenario

ENDS = {
    'ice': {'friction': ROAD_FRICTION.low},
    'grip': {'friction': ROAD_FRICTION.high},
    'slow': {'speed': {'constant_mps': SPEED.low}},
    'fast': {'speed': {'constant_mps': SPEED.high}},
    'short': {'stop': {'progress_m': 60.0, 'time_s': RUN_TIME.low}},
    'long': {'stop': {'progress_m': 60.0, 'time_s': RUN_TIME.high}},
    'patches': {
        'friction_patches': [
            {'from_m': 0, 'to_m': 9, 'from_offset_m': 0, 'to_offset_m': 2, 'friction': end}
            for end in (ROAD_FRICTION.low, ROAD_FRICTION.high)
        ]
    },
}


@pytest.mark.parametrize('controller', ['mpcc', 'frenet'])
@pytest.mark.parametrize('end', ENDS)
def test_the_ends_of_a_range_are_taken_by_controller_and_plant(end, controller, tmp_path):
    document = yaml.safe_load(scenario.load('straight').text) | ENDS[end]
    source = tmp_path / 'own.yaml'
    source.write_text(yaml.safe_dump(document))
    facts = inputs.load_facts(str(source))
    chosen = node_config.find_controller(controller)
    nodes = node_config.build_nodes(facts, chosen, 'lockstep', tmp_path, tmp_path, {})
    read = inputs.check_parameters(nodes)
    assert read['controller'][0].model.friction == facts.friction == read['plant'][0].friction
    assert read['plant'][0].start.speed_mps == facts.start['speed_mps']
    assert read['plant'][0].stop.time_s == facts.stop['time_s']


@pytest.mark.parametrize('time_s', [0.4, 601.0])
def test_a_time_out_of_the_range_of_scenarios_is_refused_by_the_plant(time_s, tmp_path):
    facts = inputs.load_facts('straight')
    settings = {'plant': {'stop.time_s': time_s}}
    chosen = node_config.find_controller('mpcc')
    nodes = node_config.build_nodes(facts, chosen, 'lockstep', tmp_path, tmp_path, settings)
    allowed = rf'{RUN_TIME.low:g} to {RUN_TIME.high:g} s'
    with pytest.raises(BagError, match=rf'--set plant\.stop\.time_s: stop\.time_s: .*{allowed}'):
        inputs.check_parameters(nodes)
