"""Parameter files with sections for several nodes of a run."""

import pytest

from bags.errors import BagError
from experiments.configuration import inputs, node_config, ros_parameter_file

FILE = """/**: {ros__parameters: {mode: realtime}}
plant:
  ros__parameters:
    friction: 0.5
    start: {speed_mps: 10.0}
/car1/controller: {ros__parameters: {tolerances.lag_m: 1e-1}}
/**/recorder: {ros__parameters: {poll_s: 0.01}}
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / 'several.yaml'
    path.write_text(FILE)
    return path


def test_a_section_is_for_its_node_and_the_source_of_a_value_is_known(file):
    values, sources = ros_parameter_file.read_files([str(file)], 'car1')
    assert values == {
        'recorder': {'mode': 'realtime', 'poll_s': 0.01},
        'scenario': {'mode': 'realtime'},
        'controller': {'mode': 'realtime', 'tolerances.lag_m': 0.1},
        'plant': {'mode': 'realtime', 'friction': 0.5, 'start.speed_mps': 10.0},
    }
    assert sources['plant']['start.speed_mps'] == f'{file}:5'


def test_of_several_files_the_last_one_counts(file, tmp_path):
    later = tmp_path / 'later.yaml'
    later.write_text('/plant: {ros__parameters: {friction: 0.4}}\n')
    values, sources = ros_parameter_file.read_files([str(file), str(later)], '/car1')
    assert values['plant']['friction'] == 0.4
    assert values['plant']['start.speed_mps'] == 10.0
    assert sources['plant']['friction'] == f'{later}:1'


def test_without_files_there_are_no_parameters():
    assert ros_parameter_file.read_files([]) == ({}, {})


@pytest.mark.parametrize(
    ('text', 'error'),
    [
        (
            'plnat: {ros__parameters: {friction: 0.5}}',
            "several.yaml:1: plnat: .*did you mean 'plant'",
        ),
        ('/car2/plant: {ros__parameters: {friction: 0.5}}', 'no node of this run'),
        ('plant: {friction: 0.5}', "unknown key|'ros__parameters' is missing"),
        ('[', 'several.yaml'),
    ],
)
def test_a_file_that_is_no_parameter_file_of_the_run_is_an_error(file, text, error):
    file.write_text(text)
    with pytest.raises(BagError, match=error):
        ros_parameter_file.read_files([str(file)], 'car1')


def test_a_value_out_of_range_names_the_file_and_the_line(file, tmp_path):
    file.write_text('plant: {ros__parameters: {friction: 50.0}}\n')
    given = ros_parameter_file.read_files([str(file)])
    nodes = node_config.build_nodes(
        inputs.load_facts('straight'),
        node_config.find_controller('mpcc'),
        'lockstep',
        tmp_path,
        tmp_path,
        *given,
    )
    with pytest.raises(BagError, match=rf'{file}:1: friction: .* allowed 0.05'):
        inputs.check_parameters(nodes)


def test_a_parameter_without_a_value_is_refused(file, tmp_path):
    file.write_text('controller: {ros__parameters: {tolerances: {lateral_jerk_mps3: }}}\n')
    given = ros_parameter_file.read_files([str(file)])
    facts, controller = inputs.load_facts('straight'), node_config.find_controller('mpcc')
    nodes = node_config.build_nodes(facts, controller, 'lockstep', tmp_path, tmp_path, *given)
    with pytest.raises(BagError, match='lateral_jerk_mps3: has no value; allowed'):
        inputs.check_parameters(nodes)
