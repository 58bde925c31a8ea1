"""Parameters become a dataclass, or the error names file, line, key and allowed range."""

import dataclasses
import re
from typing import Annotated

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from package_config import write_config

from node_runtime import node_parameters, parameters
from node_runtime.parameters import Choice, ParameterError, Range, Struct


class Axle(Struct):
    stiffness: Annotated[float, Range(1.0, 5.0, 'N/rad')]
    driven: bool


class Car(Struct):
    mass_kg: Annotated[float, Range(100.0, 5000.0, 'kg')]
    gears: Annotated[int, Range(1, 8, '-')]
    kind: Annotated[str, Choice('saloon', 'estate')]
    name: str
    ratios: Annotated[tuple[float, ...], Range(0.0, 10.0, '-')]
    front: Axle
    rear: Axle
    drag: Annotated[float, Range(0.0, 1.0, '-')] | None


CAR = Car(1500.0, 6, 'estate', 'car', (4.0, 2.0, 1.0), Axle(2.0, False), Axle(3.0, True), None)
FILE = """\
/**:
  ros__parameters:
    mass_kg: 1.5e3  # kg, empty
    gears: 6  # -
    kind: estate  # word
    name: car  # word
    ratios: [4.0, 2, 1.0]  # -
    front:
      stiffness: 2.0  # N/rad
      driven: false  # truth
    rear: {stiffness: 3, driven: true}  # N/rad, truth
"""
LINES = FILE.splitlines()
LONG = 300 * 'a'  # no file system has files of such a name
FLAT = {name: value for name, value in parameters.flatten(CAR).items() if value is not None}


@pytest.fixture
def write(tmp_path):
    """Return write(name, *lines): a parameter file with these lines, or FILE without."""

    def write(name, *lines):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        body = ''.join(f'    {line}\n' for line in lines)
        path.write_text(f'/**:\n  ros__parameters:\n{body}' if lines else FILE)
        return path

    return write


def test_a_struct_is_a_frozen_dataclass_and_its_subclass_extends_it():
    class DrivenAxle(Axle):
        torque_nm: Annotated[float, Range(0.0, 1e3, 'N m')]

    axle = DrivenAxle(2.0, True, torque_nm=300.0)
    assert [field.name for field in dataclasses.fields(axle)] == [*vars(axle)]
    with pytest.raises(dataclasses.FrozenInstanceError):
        axle.driven = False


def test_a_file_a_mapping_and_flat_values_become_the_dataclass_with_floats_for_whole_numbers(write):
    assert parameters.load(Car, write('car.yaml')) == CAR
    nested = yaml.safe_load(FILE)['/**']['ros__parameters'] | {'mass_kg': 1500}
    for values in (nested, FLAT, parameters.flatten(CAR)):
        car = parameters.build(Car, values, 'here')
        assert car == CAR
        assert isinstance(car.rear.stiffness, float)
        assert isinstance(car.gears, int)


# line, what stands there in its place, the error about the file; what is wrong with a value alone
# is in tests/msgs_yaml/test_yaml.py
FILE_MISTAKES = [
    (3, '    mass_kg: 1  # kg', ':3: mass_kg: is 1; allowed 100 to 5000 kg'),
    (3, '    mas_kg: 1  # kg', ":3: mas_kg: unknown parameter; did you mean 'mass_kg'?"),
    (3, '    wings: 2', ':3: wings: unknown parameter'),
    (3, '    mass_kg:  # kg', ':3: mass_kg: has no value; allowed 100 to 5000'),
    (4, '', ': gears: is missing; allowed 1 to 8'),
    (9, '      stifness: 1', ":9: front.stifness: unknown parameter; did you mean 'front.stiff"),
    (9, '      driven: true', ':10: front.driven: appears twice'),
    (11, f'{LINES[10]}\n    front.driven: true', ':12: front.driven: appears twice'),
    (3, f'    rear.driven: true\n{LINES[2]}', ':12: rear.driven: appears twice'),
    (
        11,
        '    rear: 1',
        ':11: rear: is a group, not a parameter; allowed rear.stiffness, rear.driven',
    ),
    (2, '  ros_parameters:', ":2: /**.ros_parameters: unknown key; did you mean 'ros__"),
    (1, 'controller:', ':1: controller: unknown key'),
    (11, '    gears: [', ':12: no valid YAML'),
    (9, '      stiffness: !!int ""', ':9: front.stiffness: '),
]


@pytest.mark.parametrize(('line', 'text', 'error'), FILE_MISTAKES)
def test_a_mistake_in_a_file_is_named_with_its_line(tmp_path, line, text, error):
    path = tmp_path / 'car.yaml'
    path.write_text('\n'.join([*LINES[: line - 1], text, *LINES[line:]]) + '\n')
    with pytest.raises(ParameterError) as caught:
        parameters.load(Car, path)
    assert str(caught.value).startswith(f'{path}{error}')


class NoRange(Struct):
    speed: float


class WrongRule(Struct):
    kind: Annotated[str, Range(0, 1, '-')]


class OddType(Struct):
    table: dict


@pytest.mark.parametrize('cls', [NoRange, WrongRule, OddType])
def test_a_field_without_a_proper_range_is_a_programming_error(cls):
    with pytest.raises(TypeError, match='is no parameter'):
        parameters.leaves(cls)


class Split(Struct):
    share_min: Annotated[float, Range(0.0, 1.0, '-')]
    share_max: Annotated[float, Range(0.0, 1.0, '-')] | None


class Limits(Struct):
    front: Split
    share_max: Annotated[float, Range(0.0, 1.0, '-')]  # of another group


@given(low=st.floats(0, 1), high=st.floats(0, 1) | st.none(), other=st.floats(0, 1))
def test_the_lower_end_of_a_range_is_not_above_its_upper_end(low, high, other):
    values = {'front': {'share_min': low, 'share_max': high}, 'share_max': other}
    if high is None or low <= high:
        assert parameters.build(Limits, values, 'here') == Limits(Split(low, high), other)
    else:
        what = f'here: front.share_min: is {low:g}, above front.share_max, {high:g}; allowed 0 to'
        with pytest.raises(ParameterError, match=f'^{re.escape(what)}'):
            parameters.build(Limits, values, 'here')


class Fan(Struct):
    on: bool
    speed: Annotated[float, Range(0.0, 9.0, '-')] | None


class Cooled(Struct):
    fan: Fan


def test_a_group_that_is_on_needs_every_parameter():
    assert parameters.build(Cooled, {'fan.on': False}, 'here').fan.speed is None
    error = 'here: fan.speed: is missing, and fan.on is true; allowed 0 to 9'
    with pytest.raises(ParameterError, match=error):
        parameters.build(Cooled, {'fan.on': True}, 'here')


def test_bases_form_a_chain_and_each_value_has_its_source_and_comment(write):
    full = write('full.yaml')
    middle = write('middle.yaml', 'base: full.yaml', 'mass_kg: 1600.0', 'drag: 0.2  # -')
    top = write('sub/top.yaml', 'base: ../middle.yaml', 'drag: 0.25', 'rear: {stiffness: 4}')
    file = parameters.read_file(top)
    own = {'mass_kg': 1600.0, 'drag': 0.25, 'rear.stiffness': 4}
    assert parameters.build(Car, file.values, 'here') == parameters.build(Car, FLAT | own, 'here')
    assert file.sources['gears'] == f'{full}:4'
    assert file.sources['mass_kg'] == f'{middle}:4'
    assert file.sources['drag'] == f'{top}:4'
    assert (file.comments['mass_kg'], file.comments['drag']) == ('kg, empty', '-')
    assert file.base.samefile(middle)
    assert repr(file) == f'ParameterFile(10 parameters, base={file.base})'


def test_a_bare_name_is_beside_the_file_or_in_config_and_a_path_is_relative_to_it(write):
    full = write('config/full.yaml')
    path = write('own/small.yaml', 'base: full.yaml', 'mass_kg: 1700.0')
    assert parameters.load(Car, path, full.parent).mass_kg == 1700.0
    write('own/full.yaml', 'mass_kg: 1800.0')
    assert parameters.read_file(path, full.parent).values == {'mass_kg': 1700.0}
    for name in ('../config/full.yaml', str(full)):
        path = write('own/small.yaml', f'base: {name}', 'mass_kg: 1700.0')
        assert parameters.load(Car, path).mass_kg == 1700.0
    path = write('own/other.yaml', 'base: ./no.yaml')
    write('config/no.yaml', 'mass_kg: 1.0')
    with pytest.raises(ParameterError, match=r'other.yaml:3: base: there is no file ./no.yaml in'):
        parameters.load(Car, path, full.parent)
    for name in ("''", '""'):
        assert parameters.read_file(write('a.yaml', f'base: {name}', 'mass_kg: 1.0')).base is None


@pytest.mark.parametrize(
    ('lines', 'error'),
    [
        (['base: no.yaml'], r'small.yaml:3: base: there is no file no.yaml in'),
        ([f'base: {LONG}'], rf'small.yaml:3: base: there is no file {LONG} in'),
        (['base: 3'], r'small.yaml:3: base: must be a text, is 3'),
        (['base: {a: 1}'], r'small.yaml: base.a: unknown parameter|small.yaml:3: base.a: unknown'),
        (['base: small.yaml'], r'small.yaml:3: .*based on each other: small.yaml -> small.yaml'),
        (
            ['base: a.yaml'],
            r'b.yaml:4: base: the files are based on each other: small.yaml -> a.yaml -> b.yaml ->',
        ),
        (['base: full.yaml', 'rear: 3'], r'small.yaml:4: rear: is a group, .* allowed rear'),
        (['base: broken.yaml'], r'broken.yaml:3: mass_kg: is 2'),
    ],
)
def test_a_mistake_in_a_chain_of_files_names_file_line_and_key(write, lines, error):
    write('full.yaml')
    write('broken.yaml', 'mass_kg: 2', 'base: full.yaml')
    write('a.yaml', 'base: b.yaml')
    write('b.yaml', 'mass_kg: 200.0', 'base: small.yaml')
    with pytest.raises(ParameterError, match=error):
        parameters.load(Car, write('small.yaml', *lines))


COMMON = {
    'mode': 'lockstep',
    'recorders': 0,
    'base': '',
    'realtime.priority': 0,
    'realtime.core': -1,
    'realtime.lock_memory': False,
    'realtime.collect_garbage': True,
    'autostart': True,
}


def values_of(declared):
    return {declaration.name: declaration.value for declaration in declared}


def test_a_node_takes_its_file_overrides_and_what_every_node_has(write):
    defaults = write('node.yaml')
    car, declared = node_parameters.resolve(Car, defaults, {})
    assert car == CAR
    assert values_of(declared) == COMMON | parameters.flatten(CAR)
    described = {declaration.name: declaration.description for declaration in declared}
    assert described['mass_kg'] == 'kg, empty; 100 to 5000 kg'
    assert described['drag'] == '0 to 1'
    given = {'mass_kg': 1600, 'ratios': [1, 2], 'mode': 'realtime', 'use_sim_time': True}
    car, declared = node_parameters.resolve(Car, defaults, given)
    assert (car.mass_kg, car.ratios) == (1600.0, (1.0, 2.0))
    assert isinstance(values_of(declared)['mass_kg'], float)
    assert values_of(declared)['mode'] == 'realtime'
    assert 'use_sim_time' not in values_of(declared)
    # ROS reads [] as no value, and no value as the word null
    given = {'ratios': None, 'drag': 'null'}
    car, _ = node_parameters.resolve(Car, defaults, given)
    assert (car.ratios, car.drag) == ((), None)


def test_a_node_without_a_life_cycle_has_no_parameter_for_it(write):
    common = node_parameters.COMMON
    _, declared = node_parameters.resolve(Car, write('node.yaml'), {}, common=common)
    assert 'autostart' not in values_of(declared)
    with pytest.raises(ParameterError, match='autostart: this node has no such parameter'):
        node_parameters.resolve(Car, write('node.yaml'), {'autostart': False}, common=common)


class WithMode(Struct):
    mode: Annotated[str, Choice('lockstep', 'realtime')]


def test_the_mode_may_be_in_the_file_of_a_node_and_be_its_own_parameter(write):
    own = write('own.yaml', 'mode: realtime')
    params, declared = node_parameters.resolve(WithMode, own, {})
    assert params.mode == 'realtime'
    assert [declaration.name for declaration in declared].count('mode') == 1
    assert node_parameters.resolve(WithMode, own, {'mode': 'lockstep'})[0].mode == 'lockstep'
    write('full.yaml')
    path = write('node.yaml', 'base: full.yaml', 'mode: realtime')
    car, declared = node_parameters.resolve(Car, path, {})
    assert (car, values_of(declared)['mode']) == (CAR, 'realtime')


FROM = 'command line or parameter file: '


@pytest.mark.parametrize(
    ('given', 'error'),
    [
        ({'geers': 1}, f"{FROM}geers: this node has no such parameter; did you mean 'gears'?"),
        ({'gears': 10}, f'{FROM}gears: is 10; allowed 1 to 8'),
        ({'gears': None}, f'{FROM}gears: must be a whole number, is None'),
        ({'front': 3}, f'{FROM}front: is a group, not a parameter; allowed front.stiffness'),
        ({'mode': 'fast'}, f"{FROM}mode: is 'fast'; allowed lockstep or realtime"),
        ({'recorders': -1}, f'{FROM}recorders: is -1; allowed 0 to 10 recorders'),
        ({'base': 'no.yaml'}, f'{FROM}base: there is no file '),
        ({'base': LONG}, f'{FROM}base: there is no file '),
        ({'base': 3}, f'{FROM}base: must be a text, is 3'),
        ({'base': None}, f'{FROM}base: must be a text, is None'),
        ({'mass_kg': 1}, 'scenario ice.yaml: mass_kg: is 1; allowed 100 to 5000 kg'),
        ({'base': 'wrong.yaml'}, '{folder}/wrong.yaml:3: gears: is 20; allowed 1 to 8'),
    ],
)
def test_a_wrong_parameter_of_a_node_names_its_source(write, given, error):
    defaults = write('node.yaml')
    write('wrong.yaml', 'gears: 20', 'base: node.yaml')
    with pytest.raises(ParameterError) as caught:
        node_parameters.resolve(Car, defaults, given, {'mass_kg': 'scenario ice.yaml'})
    assert str(caught.value).startswith(error.format(folder=defaults.parent))


def test_the_base_that_a_node_is_given_replaces_its_defaults(write, monkeypatch, tmp_path):
    defaults = write('config/full.yaml')
    light = write('config/light.yaml', 'base: full.yaml', 'mass_kg: 900.0')
    write('own.yaml', 'base: light.yaml', 'rear: {stiffness: 4.5}')
    car, declared = node_parameters.resolve(Car, defaults, {'base': 'light.yaml', 'gears': 5})
    assert (car.mass_kg, car.gears, values_of(declared)['base']) == (900.0, 5, 'light.yaml')
    monkeypatch.chdir(tmp_path)
    for name in ('./own.yaml', str(tmp_path / 'own.yaml')):
        assert node_parameters.resolve(Car, defaults, {'base': name})[0].rear.stiffness == 4.5
    # few that were not given are named, with their file
    given = {'base': 'light.yaml'} | dict.fromkeys(['gears', 'kind', 'name', 'ratios'], 1)
    some = node_parameters.describe_defaults(Car, given, defaults)
    assert some.startswith(f'5 of 10 parameters are not given and come from {light}: mass_kg, ')
    every = node_parameters.describe_defaults(Car, {}, defaults)
    assert every == f'9 of 10 parameters are not given and come from {defaults}'
    none = node_parameters.describe_defaults(Car, FLAT, defaults)
    assert none == f'0 of 10 parameters are not given and come from {defaults}'


def test_a_bare_name_is_a_file_of_config_and_a_name_with_a_separator_a_path(installed, monkeypatch):
    in_config = write_config(installed / 'venv', 'config')
    monkeypatch.chdir(installed)
    (installed / 'a.yaml').write_text('here')
    (installed / 'sub').mkdir()
    (installed / 'sub/a.yaml').write_text('below')
    monkeypatch.setenv('HOME', str(installed / 'sub'))
    assert node_parameters.find_config('some_pkg', 'a.yaml') == in_config
    paths = {'./a.yaml': 'here', f'{installed}/a.yaml': 'here', 'sub/a.yaml': 'below'}
    for name, text in (paths | {'~/a.yaml': 'below'}).items():
        assert node_parameters.find_config('some_pkg', name).read_text() == text
    for name in ('b.yaml', LONG, ''):
        with pytest.raises(FileNotFoundError, match=rf'config/{name}; it has a.yaml; .*\./{name}'):
            node_parameters.find_config('some_pkg', name)
    for name in ('./b.yaml', f'./{LONG}', '~nosuchuser/b.yaml'):
        with pytest.raises(FileNotFoundError, match=f'no file {re.escape(name)}'):
            node_parameters.find_config('some_pkg', name)
