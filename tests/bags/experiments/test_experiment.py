"""Which parameters reach which node, and what is refused before anything starts."""

import os
import socket

import pytest
import yaml

from bags import cli, closed_loop
from bags.errors import BagError
from bags.experiments import domain, experiment, run


@pytest.fixture(scope='module')
def facts():
    return closed_loop.scenario_facts('double_lane_change')


@pytest.fixture
def ring(facts, tmp_path):
    """Return ring(settings): the nodes of the double lane change."""

    def ring(*settings):
        overrides = experiment.overrides(list(settings))
        chosen = experiment.controller('mpcc')
        places = (tmp_path / 'bag', tmp_path / 'notes')
        made = experiment.nodes(facts, chosen, 'realtime', *places, overrides)
        return {node.role: node for node in made}

    return ring


def test_everybody_is_told_the_mode(ring):
    assert {node.parameters['mode'] for node in ring().values()} == {'realtime'}


def test_the_plant_starts_and_stops_where_the_scenario_says(ring, facts):
    told = ring()['plant'].parameters
    assert told['start.from'] == 'parameters'
    assert told['start.speed_mps'] == 20.8
    assert not [name for name in told if name.startswith('patches')]
    assert told['stop.x_m'] == pytest.approx(164.4, abs=0.1)
    assert facts.length_m == pytest.approx(165.0, abs=0.5)


def test_what_is_set_by_hand_wins_and_is_noted(ring):
    made = ring('plant.friction=0.7', 'controller.solver.name=ipopt', 'plant.start.speed_mps=19')
    assert made['plant'].parameters['friction'] == 0.7
    noted = experiment.noted(list(made.values()))
    assert noted['plant']['friction'] == 0.7
    assert noted['plant']['start.speed_mps'] == 19
    assert noted['controller']['solver.name'] == 'ipopt'


def test_the_notes_hold_every_parameter_of_every_node_and_of_the_files_they_name(ring):
    noted = experiment.noted(list(ring().values()))
    assert list(noted) == list(experiment.ROLES)
    assert noted['controller']['tyre.front_friction'] > 0.0
    assert noted['controller']['priorities.obstacle'] > 0.0
    assert noted['plant']['car.body.mass_kg'] > 0.0
    assert noted['recorder']['chunk_s'] > 0.0


def test_parameters_are_written_as_ros_reads_them(ring, tmp_path):
    node = ring()['plant']
    experiment.write_parameters(node, tmp_path / 'plant.yaml')
    read = yaml.safe_load((tmp_path / 'plant.yaml').read_text())
    assert read == {'/**': {'ros__parameters': node.parameters}}


@pytest.mark.parametrize('text', ['plant.friction', 'friction=1', 'wheel.size=1', 'plant.x=[1'])
def test_a_setting_in_another_form_is_refused(text):
    with pytest.raises(BagError, match='--set'):
        experiment.overrides([text])


def test_a_controller_may_be_a_file_of_its_own(tmp_path):
    own = tmp_path / 'brave.yaml'
    own.write_text('')
    assert experiment.controller(str(own)) == ('brave', 'mpcc_node', own)
    assert experiment.controller('mpcc_no_ca').config.name == 'mpcc_no_ca.yaml'
    for wrong in ('timid', str(tmp_path / 'timid.yaml')):
        with pytest.raises(BagError, match='timid'):
            experiment.controller(wrong)


def test_a_name_that_is_no_controller_is_refused_with_those_that_are():
    known = 'frenet, frenet_tuned, mpcc, mpcc_no_ca, mpcc_no_ca_tuned, mpcc_tuned'
    for wrong in ('timid', 'car'):
        with pytest.raises(BagError, match=f"'{wrong}'; there are {known}"):
            experiment.controller(wrong)


def test_two_controllers_of_one_name_are_refused(tmp_path):
    own = tmp_path / 'mpcc.yaml'
    own.write_text('')
    with pytest.raises(BagError, match="called 'mpcc'"):
        experiment.controllers(['mpcc', str(own)])
    mpcc = experiment.controller('mpcc')
    assert experiment.controllers(['mpcc', 'mpcc', str(mpcc.config)]) == [mpcc]


def test_a_number_is_read_as_ros_reads_it(ring):
    assert ring('plant.friction=1e-1')['plant'].parameters['friction'] == 0.1
    assert ring("plant.tyre_set='1e-1'")['plant'].parameters['tyre_set'] == '1e-1'


def test_a_controller_file_with_few_keys_is_noted_with_the_defaults_of_the_node(facts, tmp_path):
    own = tmp_path / 'brave.yaml'
    own.write_text('/**:\n  ros__parameters:\n    safety:\n      obstacle_m: 0.1\n')
    places = (tmp_path / 'bag', tmp_path / 'notes')
    chosen = experiment.controller(str(own))
    made = experiment.nodes(facts, chosen, 'lockstep', *places, {})
    noted = experiment.noted(made)['controller']
    assert noted['safety.obstacle_m'] == 0.1
    assert noted['safety.edge_m'] == 0.5
    assert noted['tyre.front_friction'] > 0.0
    closed_loop.check_parameters(made)


@pytest.mark.parametrize(
    ('settings', 'said'),
    [
        (['--set', 'plant.friction=1e-1x'], 'friction: must be a number'),
        (['--set', 'plant.frictoin=1'], "did you mean 'friction'"),
        (['--set', 'plant.tyre_set=nosuch.yaml'], 'nosuch.yaml'),
        (['--set', 'plant.plant_params=1'], 'config/1'),
        (['--set', 'controller.car_file=nosuch.yaml'], 'nosuch.yaml'),
        (['--controller', 'car'], 'there are frenet, frenet_tuned, mpcc'),
        (['--controller', 'broken.yaml'], 'broken.yaml'),
        (['--out', '/dev/null'], '/dev/null'),
    ],
)
def test_what_no_node_would_start_with_is_one_line_before_anything_starts(
    settings, said, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'broken.yaml').write_text('/**: [1')
    assert cli.main(['run', 'straight', *settings]) == 1
    shown = capsys.readouterr()
    assert shown.out == ''
    assert shown.err.startswith('error: ')
    assert shown.err.count('\n') == 1
    assert said in shown.err


@pytest.mark.parametrize('limit', ['0', '-1', 'nan', 'inf', 'soon'])
def test_a_time_limit_is_a_time(limit, capsys):
    with pytest.raises(SystemExit):
        cli.main(['run', 'straight', '--time-limit', limit])
    assert '--time-limit' in capsys.readouterr().err


def test_a_scenario_that_does_not_exist_is_refused_with_those_that_do():
    with pytest.raises(BagError, match='double_lane_change'):
        closed_loop.scenario_facts('double_lane')


def test_two_runs_never_share_a_domain():
    with domain.reserved({}) as one, domain.reserved({}) as other:
        assert one != other
        assert {one, other} <= set(range(1, domain.LAST + 1))


def test_a_domain_that_somebody_listens_in_is_not_taken(monkeypatch):
    monkeypatch.setattr(os, 'getpid', lambda: 55 - 1)
    with domain.reserved({}) as free:
        assert free == 55
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(('', 7400 + 250 * 55 + 10))
        with domain.reserved({}) as free:
            assert free == 56


def test_a_domain_that_is_given_is_kept():
    with domain.reserved({'ROS_DOMAIN_ID': '57'}) as number:
        assert number == 57


def test_in_a_given_domain_somebody_may_look_on():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as viewer:
        viewer.bind(('', 7400 + 250 * 57 + 10))
        with domain.reserved({'ROS_DOMAIN_ID': '57'}) as number:
            assert number == 57


def test_a_given_domain_in_which_another_run_is_is_refused():
    given = {'ROS_DOMAIN_ID': '57'}
    with (
        domain.reserved(given),
        pytest.raises(BagError, match='ROS_DOMAIN_ID=57'),
        domain.reserved(given),
    ):
        pass


@pytest.mark.parametrize('given', ['abc', '-1', '233', '1.5'])
def test_a_domain_is_a_number_that_has_ports(given):
    wanted = 'from 0 to 232'
    with pytest.raises(BagError, match=wanted), domain.reserved({'ROS_DOMAIN_ID': given}):
        pass


def test_on_the_wall_clock_plant_and_controller_have_a_core_each(monkeypatch):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda pid: {3, 5, 7})
    assert run._cores('realtime') == {'plant': {3}, 'controller': {5}}
    assert run._cores('lockstep') == {}
    monkeypatch.setattr(os, 'sched_getaffinity', lambda pid: {3})
    assert run._cores('realtime') == {}
