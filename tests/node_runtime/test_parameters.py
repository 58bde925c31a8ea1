"""Parameters become a dataclass, or the error names file, line, key and allowed range."""

import dataclasses
import math
from typing import Annotated

import pytest
from hypothesis import given
from hypothesis import strategies as st

from node_runtime import parameters
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


VALUES = {
    'mass_kg': 1500.0,
    'gears': 6,
    'kind': 'estate',
    'name': 'car',
    'ratios': [4.0, 2, 1.0],
    'front': {'stiffness': 2.0, 'driven': False},
    'rear': {'stiffness': 3, 'driven': True},
}
CAR = Car(1500.0, 6, 'estate', 'car', (4.0, 2.0, 1.0), Axle(2.0, False), Axle(3.0, True))
FILE = """\
/**:
  ros__parameters:
    mass_kg: 1.5e3  # kg
    gears: 6  # -
    kind: estate  # word
    name: car  # word
    ratios: [4.0, 2, 1.0]  # -
    front:
      stiffness: 2.0  # N/rad
      driven: false  # truth
    rear: {stiffness: 3, driven: true}  # N/rad, truth
"""


def write(tmp_path, text):
    path = tmp_path / 'car.yaml'
    path.write_text(text)
    return path


def without(key):
    return {name: value for name, value in VALUES.items() if name != key}


def test_a_struct_is_a_frozen_dataclass_and_its_subclass_extends_it():
    class DrivenAxle(Axle):
        torque_nm: Annotated[float, Range(0.0, 1e3, 'N m')]

    axle = DrivenAxle(2.0, True, torque_nm=300.0)
    assert [field.name for field in dataclasses.fields(axle)] == [*vars(axle)]
    assert axle == DrivenAxle(2.0, True, 300.0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        axle.driven = False


def test_a_mapping_becomes_the_dataclass_with_whole_numbers_as_floats():
    car = parameters.build(Car, VALUES, 'here')
    assert car == CAR
    assert isinstance(car.rear.stiffness, float)
    assert isinstance(car.gears, int)


def test_flattening_is_undone_by_building():
    flat = parameters.flatten(CAR)
    assert flat['rear.driven'] is True
    assert parameters.build(Car, flat, 'here') == CAR


def test_a_ros_parameter_file_becomes_the_dataclass(tmp_path):
    assert parameters.load(Car, write(tmp_path, FILE)) == CAR


MISTAKES = [
    ({'mass_kg': math.nan}, 'mass_kg: must be finite, is nan; allowed 100 to 5000 kg'),
    ({'mass_kg': '1500'}, "mass_kg: must be a number, is '1500'; allowed 100 to 5000 kg"),
    ({'gears': 9}, 'gears: is 9; allowed 1 to 8'),
    ({'kind': 'estat'}, "kind: is 'estat'; did you mean 'estate'.; allowed saloon or estate"),
    ({'name': 3}, 'name: must be a text, is 3; allowed any text'),
    ({'ratios': 3.0}, 'ratios: must be a list, is 3.0; allowed 0 to 10'),
    ({'ratios': [1.0, 'x']}, "ratios: must be a number, is 'x'; allowed 0 to 10"),
    ({'front.driven': 1}, 'front.driven: must be true or false, is 1; allowed true or false'),
    ({'front.stifness': 1}, "front.stifness: unknown parameter; did you mean 'front.stiffness'"),
    ({'front': 1}, 'front: is a group, not a parameter; allowed front'),
    ({'wings': 2}, 'wings: unknown parameter$'),
]


@pytest.mark.parametrize(('change', 'error'), MISTAKES, ids=str)
def test_the_error_for_a_wrong_value_names_key_and_range(change, error):
    flat = parameters.flatten(CAR)
    with pytest.raises(ParameterError, match=f'^here: {error}'):
        parameters.build(Car, {**flat, **change}, 'here')


@pytest.mark.parametrize('key', VALUES)
def test_a_missing_value_is_named(key):
    with pytest.raises(ParameterError, match=rf'^here: {key}.*: is missing; allowed'):
        parameters.build(Car, without(key), 'here')


@pytest.mark.parametrize(
    ('line', 'text', 'error'),
    [
        (3, '    mass_kg: 1  # kg', r'car.yaml:3: mass_kg: is 1; allowed 100 to'),
        (3, '    mas_kg: 1  # kg', r"car.yaml:3: mas_kg: unknown .* did you mean 'mass_kg'"),
        (3, '    mass_kg:  # kg', r'car.yaml:3: mass_kg: has no value; allowed 100 to 5000'),
        (9, '      stiffness: ', r'car.yaml:9: front.stiffness: has no value; allowed '),
        (
            11,
            '    rear:',
            r'car.yaml:11: rear: is a group, .* allowed rear.stiffness, ',
        ),
        (9, '      stiffness: x', r"car.yaml:9: front.stiffness: must be a number, is 'x'"),
        (9, '      driven: true', r'car.yaml:10: .*front.driven: appears twice'),
        (2, '  ros_parameters:', r"car.yaml:2: .*ros_parameters: unknown key; did you mean 'ros__"),
        (1, 'controller:', r'car.yaml:1: controller: unknown key'),
        (4, '    gears: [', r'car.yaml:\d+: no valid YAML'),
    ],
)
def test_a_mistake_in_a_file_is_named_with_its_line(tmp_path, line, text, error):
    lines = FILE.splitlines()
    path = write(tmp_path, '\n'.join([*lines[: line - 1], text, *lines[line:]]))
    with pytest.raises(ParameterError, match=error):
        parameters.load(Car, path)


def test_a_value_missing_from_a_file_names_the_file(tmp_path):
    path = write(tmp_path, FILE.replace('    gears: 6  # -\n', ''))
    with pytest.raises(ParameterError, match=r'car.yaml: gears: is missing; allowed 1 to 8'):
        parameters.load(Car, path)


@given(st.floats(100.0, 5000.0))
def test_every_number_in_the_range_is_unchanged(mass_kg):
    assert parameters.build(Car, {**VALUES, 'mass_kg': mass_kg}, 'here').mass_kg == mass_kg


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


@pytest.mark.parametrize(
    'value',
    [
        '!!python/object:os.system',
        '!nobody x',
        '!!bool maybe',
        '!!int ""',
        '!!timestamp soon',
        '2026-13-01',
        '9' * 400,
    ],
)
def test_text_that_is_no_yaml_value_is_rejected_with_its_line(tmp_path, value):
    path = tmp_path / 'car.yaml'
    path.write_text(f'/**:\n  ros__parameters:\n    stiffness: {value}\n    driven: true\n')
    with pytest.raises(ParameterError, match=r'car\.yaml:3: .*stiffness: '):
        parameters.load(Axle, path)


class Drive(Struct):
    share: Annotated[float, Range(0.0, 1.0, '-')] | None
    name: str


def test_an_optional_parameter_may_be_left_out_and_is_checked_when_it_is_not():
    assert parameters.build(Drive, {'name': 'a'}, 'here') == Drive(None, 'a')
    assert parameters.build(Drive, {'name': 'a', 'share': None}, 'here') == Drive(None, 'a')
    assert parameters.build(Drive, {'name': 'a', 'share': 1}, 'here') == Drive(1.0, 'a')
    with pytest.raises(ParameterError, match='here: share: is 2; allowed 0 to 1'):
        parameters.build(Drive, {'name': 'a', 'share': 2}, 'here')
    with pytest.raises(ParameterError, match='name: is missing'):
        parameters.build(Drive, {'share': 1.0}, 'here')


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
        message = (
            f'here: front.share_min: is {low:g}, above front.share_max, {high:g}; allowed 0 to'
        )
        with pytest.raises(ParameterError) as error:
            parameters.build(Limits, values, 'here')
        assert str(error.value).startswith(message)
