"""Overrides come before the parameter file; errors name the source of a wrong value."""

import math
import re
from typing import Annotated

import pytest
from package_config import write_config

from node_runtime import node_parameters
from node_runtime.parameters import Choice, ParameterError, Range, Struct


class Params(Struct):
    gain: Annotated[float, Range(0.0, 9.0, 'N')]
    widths: Annotated[tuple[float, ...], Range(0.0, 9.0, 'm')]


class WithMode(Struct):
    mode: Annotated[str, Choice('lockstep', 'realtime')]
    gain: Annotated[float, Range(0.0, 9.0, 'N')]


@pytest.fixture
def defaults(tmp_path):
    path = tmp_path / 'node.yaml'
    path.write_text(
        '/**:\n  ros__parameters:\n    gain: 2.0  # N per metre of error\n    widths: [1.0]\n'
    )
    return path


def test_without_overrides_the_values_come_from_the_file(defaults):
    params, declared = node_parameters.resolve(Params, defaults, {})
    assert params == Params(2.0, (1.0,))
    assert {declaration.name: declaration.value for declaration in declared} == {
        'mode': 'lockstep',
        'recorders': 0,
        'base': '',
        'realtime.priority': 0,
        'realtime.core': -1,
        'realtime.lock_memory': False,
        'realtime.collect_garbage': True,
        'autostart': True,
        'gain': 2.0,
        'widths': (1.0,),
    }


def test_a_node_without_a_life_cycle_has_no_parameter_for_it(defaults):
    common = node_parameters.COMMON
    _, declared = node_parameters.resolve(Params, defaults, {}, common=common)
    assert 'autostart' not in {declaration.name for declaration in declared}
    with pytest.raises(ParameterError, match='autostart: this node has no such parameter'):
        node_parameters.resolve(Params, defaults, {'autostart': False}, common=common)


def test_overrides_replace_the_values_of_the_file_and_may_be_whole_numbers(defaults):
    given = {'gain': 3, 'widths': [1, 2], 'mode': 'realtime', 'use_sim_time': True}
    params, declared = node_parameters.resolve(Params, defaults, given)
    assert params == Params(3.0, (1.0, 2.0))
    values = {declaration.name: declaration.value for declaration in declared}
    assert values['mode'] == 'realtime'
    assert isinstance(values['gain'], float)
    assert 'use_sim_time' not in values


def test_none_for_a_list_is_an_empty_list(defaults):
    assert node_parameters.resolve(Params, defaults, {'widths': None})[0].widths == ()


def test_the_comment_in_the_file_is_the_description(defaults):
    _, declared = node_parameters.resolve(Params, defaults, {})
    described = {declaration.name: declaration.description for declaration in declared}
    assert described['gain'] == 'N per metre of error; 0 to 9 N'
    assert described['widths'] == '0 to 9 m'


@pytest.mark.parametrize(
    ('given', 'error'),
    [
        ({'gian': 1.0}, "gian: this node has no such parameter; did you mean 'gain'"),
        ({'gain': 10}, 'gain: is 10; allowed 0 to 9 N'),
        ({'gain': math.nan}, 'gain: must be finite'),
        ({'gain': None}, 'gain: must be a number, is None'),
        ({'gain': 'x'}, "gain: must be a number, is 'x'"),
        ({'widths': 3}, 'widths: must be a list, is 3'),
        ({'mode': 'fast'}, "mode: is 'fast'; allowed lockstep or realtime"),
        ({'mode': 3}, 'mode: must be a text, is 3'),
        ({'recorders': -1}, 'recorders: is -1; allowed 0 to 10 recorders'),
    ],
)
def test_a_wrong_override_names_the_command_line(defaults, given, error):
    with pytest.raises(ParameterError, match=f'^command line or parameter file: {error}'):
        node_parameters.resolve(Params, defaults, given)


def test_a_wrong_default_names_the_file_and_line(defaults):
    defaults.write_text(defaults.read_text().replace('2.0', '20'))
    with pytest.raises(ParameterError, match=r'node.yaml:3: gain: is 20; allowed'):
        node_parameters.resolve(Params, defaults, {})


def test_a_node_may_declare_the_mode_as_its_own_parameter(tmp_path):
    path = tmp_path / 'node.yaml'
    path.write_text('/**:\n  ros__parameters: {mode: realtime, gain: 1.0}\n')
    params, declared = node_parameters.resolve(WithMode, path, {})
    assert params.mode == 'realtime'
    assert [declaration.name for declaration in declared].count('mode') == 1
    assert node_parameters.resolve(WithMode, path, {'mode': 'lockstep'})[0].mode == 'lockstep'


def test_the_file_of_any_node_may_set_the_mode(defaults):
    defaults.write_text(defaults.read_text() + '    mode: realtime\n')
    params, declared = node_parameters.resolve(Params, defaults, {})
    assert params == Params(2.0, (1.0,))
    assert {declaration.name: declaration.value for declaration in declared}['mode'] == 'realtime'


def test_an_error_names_the_source_of_an_override(defaults):
    sources = {'gain': 'scenario ice.yaml: friction'}
    with pytest.raises(ParameterError, match=r'^scenario ice.yaml: friction: gain: .* 0 to 9 N'):
        node_parameters.resolve(Params, defaults, {'gain': -1.0}, sources)
    with pytest.raises(ParameterError, match=r'^command line or parameter file: widths: '):
        node_parameters.resolve(Params, defaults, {'widths': [-1.0]}, sources)


def test_the_parameters_that_were_not_given_are_counted_and_named_with_their_file(defaults):
    some = node_parameters.describe_defaults(Params, {'gain': 3.0, 'mode': 'realtime'}, defaults)
    assert some == f'1 of 2 parameters are not given and come from {defaults}: widths'
    every = node_parameters.describe_defaults(Params, {}, defaults)
    assert every == f'2 of 2 parameters are not given and come from {defaults}'
    assert node_parameters.describe_defaults(
        Params, {'gain': 1.0, 'widths': ()}, defaults
    ).startswith('0 of')


def test_a_bare_name_is_a_file_of_config_and_a_name_with_a_separator_a_path(installed, monkeypatch):
    in_config = write_config(installed / 'venv', 'config')
    monkeypatch.chdir(installed)
    (installed / 'a.yaml').write_text('here')
    (installed / 'sub').mkdir()
    (installed / 'sub/a.yaml').write_text('below')
    assert node_parameters.find_config('some_pkg', 'a.yaml') == in_config
    assert node_parameters.find_config('some_pkg', './a.yaml').read_text() == 'here'
    assert node_parameters.find_config('some_pkg', 'sub/a.yaml').read_text() == 'below'
    assert node_parameters.find_config('some_pkg', str(installed / 'a.yaml')).read_text() == 'here'
    monkeypatch.setenv('HOME', str(installed / 'sub'))
    assert node_parameters.find_config('some_pkg', '~/a.yaml').read_text() == 'below'


def test_the_error_for_a_missing_file_lists_the_files_and_the_form_of_a_path(installed):
    write_config(installed / 'venv', 'config')
    for name in ('b.yaml', ''):
        with pytest.raises(FileNotFoundError, match=rf'config/{name}; it has a.yaml; .*\./{name}'):
            node_parameters.find_config('some_pkg', name)
    for name in ('./b.yaml', '~nosuchuser/b.yaml'):
        with pytest.raises(FileNotFoundError, match=f'no file {re.escape(name)}'):
            node_parameters.find_config('some_pkg', name)
