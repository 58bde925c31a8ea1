"""A parameter file holds what differs from its base; errors name file, line and key."""

from typing import Annotated

import pytest
import yaml

from node_runtime import node_parameters, parameters
from node_runtime.parameters import ParameterError, Range, Struct


class Wheel(Struct):
    radius_m: Annotated[float, Range(0.1, 1.0, 'm')]
    width_m: Annotated[float, Range(0.1, 1.0, 'm')] | None


class Car(Struct):
    mass_kg: Annotated[float, Range(100.0, 5000.0, 'kg')]
    wheel: Wheel
    gears: Annotated[tuple[int, ...], Range(1, 9, '-')]


FULL = """/**:
  ros__parameters:
    mass_kg: 1500.0  # kg, empty
    wheel:
      radius_m: 0.3  # m
    gears: [1, 2, 3]  # -
"""
VALUES = {'mass_kg': 1500.0, 'wheel.radius_m': 0.3, 'gears': [1, 2, 3]}


@pytest.fixture
def write(tmp_path):
    """Return write(name, text): a parameter file with these lines, or FULL without."""

    def write(name, *lines):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        body = ''.join(f'    {line}\n' for line in lines)
        path.write_text(f'/**:\n  ros__parameters:\n{body}' if lines else FULL)
        return path

    return write


def test_a_file_overrides_its_base_key_by_key(write):
    write('full.yaml')
    path = write('small.yaml', 'base: full.yaml', 'wheel: {radius_m: 0.4}', 'gears: [4]')
    assert parameters.load(Car, path) == Car(1500.0, Wheel(0.4, None), (4,))


def test_bases_form_a_chain_and_each_value_has_its_source_and_comment(write, tmp_path):
    full = write('full.yaml')
    middle = write('middle.yaml', 'base: full.yaml', 'mass_kg: 1600.0', 'wheel.width_m: 0.2  # m')
    top = write('sub/top.yaml', 'base: ../middle.yaml', 'wheel.width_m: 0.25')
    file = parameters.read_file(top)
    assert file.values == {**VALUES, 'mass_kg': 1600.0, 'wheel.width_m': 0.25}
    assert file.sources['gears'] == f'{full}:6'
    assert file.sources['mass_kg'].endswith(f'{middle.name}:4')
    assert file.sources['wheel.width_m'] == f'{top}:4'
    assert file.comments['mass_kg'] == 'kg, empty'
    assert file.comments['wheel.width_m'] == 'm'
    assert file.base.samefile(middle)
    assert repr(file) == f'ParameterFile(4 parameters, base={file.base})'


def test_a_bare_name_is_looked_for_beside_the_file_and_then_in_config(write, tmp_path):
    config = write('config/full.yaml').parent
    path = write('own/small.yaml', 'base: full.yaml', 'mass_kg: 1700.0')
    with pytest.raises(ParameterError, match=r'small.yaml:3: base: there is no file full.yaml in'):
        parameters.load(Car, path)
    assert parameters.load(Car, path, config).mass_kg == 1700.0
    write('own/full.yaml', 'mass_kg: 1800.0')
    assert parameters.read_file(path, config).values == {'mass_kg': 1700.0}


def test_a_path_is_relative_to_the_file_or_absolute(write, tmp_path):
    full = write('config/full.yaml')
    for name in ('../config/full.yaml', str(full)):
        path = write('own/small.yaml', f'base: {name}', 'mass_kg: 1700.0')
        assert parameters.load(Car, path).mass_kg == 1700.0
    path = write('own/small.yaml', 'base: ./full.yaml')
    with pytest.raises(ParameterError, match=r'small.yaml:3: base: there is no file ./full.yaml'):
        parameters.load(Car, path, full.parent)


@pytest.mark.parametrize('name', ["''", '""'])
def test_an_empty_base_is_none(write, name):
    assert parameters.read_file(write('small.yaml', f'base: {name}', 'mass_kg: 1.0')).base is None


@pytest.mark.parametrize(
    ('lines', 'error'),
    [
        (['base: no.yaml'], r'small.yaml:3: base: there is no file no.yaml in'),
        (['base: 3'], r'small.yaml:3: base: must be a text, is 3'),
        (['base: {a: 1}'], r'small.yaml: base.a: unknown parameter|small.yaml:3: base.a: unknown'),
        (['base: small.yaml'], r'small.yaml:3: .*based on each other: small.yaml -> small.yaml'),
        (['base: full.yaml', 'mas_kg: 1'], r"small.yaml:4: mas_kg: unknown .* mean 'mass_kg'"),
        (['base: full.yaml', 'mass_kg: 1'], r'small.yaml:4: mass_kg: is 1'),
        (
            ['base: full.yaml', 'wheel: 3'],
            r'small.yaml:4: wheel: is a group, not a parameter; allowed wheel',
        ),
        (['base: broken.yaml'], r'broken.yaml:3: mass_kg: is 2'),
    ],
)
def test_a_mistake_names_file_line_and_key(write, lines, error):
    write('full.yaml')
    write('broken.yaml', 'mass_kg: 2', 'base: full.yaml')
    path = write('small.yaml', *lines)
    with pytest.raises(ParameterError, match=error):
        parameters.load(Car, path)


def test_a_cycle_is_named_with_its_files(write):
    write('a.yaml', 'base: b.yaml')
    write('b.yaml', 'mass_kg: 200.0', 'base: c.yaml')
    write('c.yaml', 'base: a.yaml')
    cycle = r'a.yaml -> b.yaml -> c.yaml -> a.yaml'
    with pytest.raises(ParameterError, match=rf'c.yaml:3: base: the files .*: {cycle}'):
        parameters.read_file(write('a.yaml', 'base: b.yaml'))


def test_the_defaults_of_a_node_may_have_a_base(write):
    write('full.yaml')
    path = write('small.yaml', 'base: full.yaml', 'mass_kg: 1600.0')
    car, declared = node_parameters.resolve(Car, path, {'wheel.radius_m': 0.5})
    assert car == Car(1600.0, Wheel(0.5, None), (1, 2, 3))
    declared = {declaration.name: declaration for declaration in declared}
    assert declared['base'].value == ''
    assert declared['mass_kg'].description == 'kg, empty; 100 to 5000 kg'


def test_the_base_that_a_node_is_given_replaces_its_defaults(write, monkeypatch, tmp_path):
    defaults = write('config/full.yaml')
    write('config/light.yaml', 'base: full.yaml', 'mass_kg: 900.0')
    write('own.yaml', 'base: light.yaml', 'wheel: {radius_m: 0.6}')
    given = {'base': 'light.yaml', 'gears': [5]}
    car, declared = node_parameters.resolve(Car, defaults, given)
    assert car == Car(900.0, Wheel(0.3, None), (5,))
    assert {declaration.name: declaration.value for declaration in declared}['base'] == 'light.yaml'
    summary = node_parameters.describe_defaults(Car, given, defaults)
    light = defaults.parent / 'light.yaml'
    assert summary == (
        f'2 of 4 parameters are not given and come from {light}: mass_kg, wheel.radius_m'
    )
    monkeypatch.chdir(tmp_path)
    for name in ('./own.yaml', str(tmp_path / 'own.yaml')):
        assert node_parameters.resolve(Car, defaults, {'base': name})[0].wheel.radius_m == 0.6


@pytest.mark.parametrize(
    ('base', 'error'),
    [
        ('no.yaml', 'base: there is no file .*no.yaml'),
        (3, 'base: must be a text, is 3'),
        (None, 'base: must be a text, is None'),
    ],
)
def test_a_wrong_base_that_a_node_is_given_names_its_source(write, base, error):
    defaults = write('full.yaml')
    with pytest.raises(ParameterError, match=f'^command line or parameter file: {error}'):
        node_parameters.resolve(Car, defaults, {'base': base})


def test_the_output_of_ros2_param_dump_is_a_parameter_file(write, tmp_path):
    """It has the name of the node, and every parameter, those of all nodes included."""
    defaults = write('full.yaml')
    car, declared = node_parameters.resolve(Car, defaults, {'mass_kg': 2000.0})
    values = {declaration.name: declaration.value for declaration in declared} | {
        'use_sim_time': False,
        'gears': [1, 2, 3],
    }
    dump = tmp_path / 'dump.yaml'
    dump.write_text(yaml.safe_dump({'/car1/test_node': {'ros__parameters': values}}))
    values = parameters.read_file(dump).values
    assert node_parameters.resolve(Car, defaults, values) == (car, declared)
