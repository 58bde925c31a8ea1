from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msgs_yaml import strict_yaml
from msgs_yaml.strict_yaml import Choice, Pattern, Range, Struct, YamlError

Metres = Annotated[float, Range(0.0, 10.0, 'm')]


class Square(Struct):
    side_m: Metres


class Disc(Struct):
    radius_m: Metres
    count: Annotated[int, Range(1, 3, '-')] = 1


class Drawing(Struct):
    version: Literal[2]
    word: Annotated[str, Pattern('[a-z]+', 'small letters')]
    shape: Square | Disc
    marks: tuple[tuple[Metres, Metres], ...] = ()


def read(text):
    return strict_yaml.parse_value(Drawing, strict_yaml.parse(text, 'a.yaml'))


def drawing(version='2', word='a', shape='{side_m: 1}', rest=''):
    return f'version: {version}\nword: {word}\nshape: {shape}\n{rest}'


def test_complete_file_becomes_typed_values():
    made = read(drawing(shape='{radius_m: 2, count: 3}', rest='marks: [[1, 2.5], [3e0, .5]]'))
    assert made == Drawing(2, 'a', Disc(2.0, 3), ((1.0, 2.5), (3.0, 0.5)))
    assert isinstance(made.shape.radius_m, float)


def test_key_with_a_default_may_be_left_out():
    assert read(drawing(shape='{radius_m: 2}')).shape.count == 1


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        (drawing(version='1'), 'a.yaml:1: version: is 1; allowed 2'),
        (drawing(version='2.0'), 'a.yaml:1: version: must be a whole number, is 2.0; allowed 2'),
        (drawing(word='A'), "a.yaml:2: word: is 'A'; allowed small letters"),
        (
            drawing(word='[a]'),
            'a.yaml:2: word: must be a single value, is a sequence; allowed small letters',
        ),
        (
            drawing(word='2001-99-99'),
            "a.yaml:2: word: '2001-99-99' is no timestamp: month must be in 1..12",
        ),
        (
            drawing(shape='{sid_m: 1}'),
            "a.yaml:3: shape: has none of side_m, radius_m; did you mean 'side_m'?; "
            'allowed exactly one of side_m, radius_m',
        ),
        (
            drawing(shape='{side_m: 1, radius_m: 1}'),
            'a.yaml:3: shape: has side_m and radius_m; allowed exactly one of side_m, radius_m',
        ),
        (
            drawing(shape='{radius_m: 1, cuont: 2}'),
            "a.yaml:3: shape.cuont: unknown key; did you mean 'count'?; allowed radius_m, count",
        ),
        (
            drawing(shape='{radius_m: 1, count: 1.5}'),
            'a.yaml:3: shape.count: must be a whole number, is 1.5; allowed 1 to 3',
        ),
        (
            drawing(rest='marks: [[1, 2], [1]]'),
            'a.yaml:4: marks[1]: has 1 elements; allowed exactly 2',
        ),
        (
            drawing(rest='marks: [[1, 2], [1, x]]'),
            "a.yaml:4: marks[1][1]: must be a number, is 'x'; allowed 0 to 10 m",
        ),
        (drawing(rest='word: b'), 'a.yaml:4: word: appears twice'),
        (drawing(rest='[1]: b'), 'a.yaml:4: a key must be one word'),
        ('version: 2\nword: a', 'a.yaml:1: shape: is missing'),
        ('word: a\nshape: {side_m: 1}', 'a.yaml:1: version: is missing; allowed 2'),
        ('[]', 'a.yaml:1: must be a mapping, is a list'),
    ],
)
def test_mistake_names_file_line_key_and_what_is_allowed(text, message):
    with pytest.raises(YamlError) as caught:
        read(text)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ('number', 'what'),
    [
        ('.nan', 'must be finite, is .nan'),
        ('-.inf', 'must be finite, is -.inf'),
        ('1.0e999', 'must be finite, is 1.0e999'),
        ('11', 'is 11'),
        ('-1.0e-9', 'is -1.0e-9'),
        ('true', 'must be a number, is true'),
        ('"1"', "must be a number, is '1'"),
        ('', 'has no value'),
        ('~', "must be a number, is '~'"),
        ('1,5', "must be a number, is '1,5'"),
        ('"2"', "must be a number, is '2'"),
        pytest.param('0x' + 'f' * 5000, f'is 0x{"f" * 58}...', id='hex'),
    ],
)
def test_what_is_no_number_in_range_is_refused(number, what):
    shape = f'\n  side_m: {number}'
    with pytest.raises(YamlError) as caught:
        read(drawing(shape=shape))
    assert str(caught.value) == f'a.yaml:4: shape.side_m: {what}; allowed 0 to 10 m'


def test_a_number_beyond_all_is_refused_and_not_repeated_in_full():
    with pytest.raises(YamlError, match=r"^a.yaml:3: shape.side_m: '9{60}...' is no int: "):
        read(drawing(shape=f'{{side_m: {"9" * 5000}}}'))


@given(value=st.floats(0.0, 10.0))
def test_every_number_in_range_comes_back_as_it_was_written(value):
    assert read(drawing(shape=f'{{side_m: {value!r}}}')).shape.side_m == value


@given(value=st.text(max_size=8))
def test_any_text_is_a_value_or_a_named_error(value):
    try:
        made = read(drawing(word=value))
    except YamlError as caught:
        said = str(caught)
    else:
        said = f'a.yaml holds {made.word}'
    assert said.startswith('a.yaml')


@pytest.mark.parametrize(
    ('hint', 'value', 'fault'),
    [
        (Metres, None, 'must be a number, is None; allowed 0 to 10 m'),
        (Metres, [1.0], 'must be a number, is [1.0]; allowed 0 to 10 m'),
        (Metres | None, None, ''),
        (
            Annotated[int, Range(1, 3, '-')],
            False,
            'must be a whole number, is False; allowed 1 to 3',
        ),
        (Annotated[str, Choice('a', 'b')], 3, 'must be a text, is 3; allowed a or b'),
        (
            Annotated[tuple[float, ...], Range(0, 1, '-')],
            '12',
            "must be a list, is '12'; allowed 0 to 1",
        ),
        (Annotated[tuple[float, ...], Range(0, 1, '-')], [1.0, 2.0], 'is 2.0; allowed 0 to 1'),
        (bool, 1, 'must be true or false, is 1; allowed true or false'),
        (str, strict_yaml.EMPTY, 'has no value; allowed any text'),
    ],
)
def test_the_fault_of_a_value_from_elsewhere_is_told_alike(hint, value, fault):
    assert strict_yaml.leaf_of(hint).fault(value) == fault


def test_absurdly_long_list_is_refused():
    rows = ','.join('0' * (strict_yaml.MAX_ELEMENTS + 1))
    with pytest.raises(YamlError, match='has 100001 elements; allowed at most 100000'):
        read(drawing(rest=f'marks: [{rows}]'))
