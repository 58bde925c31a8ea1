"""YAML is read strictly: typed values, or an error that names file, line, key and range."""

import re
from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msgs_yaml import share, strict_yaml
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
    assert read(drawing(shape='{radius_m: 2}')).shape.count == 1


EITHER = '; allowed exactly one of side_m, radius_m'
MISTAKES = [
    (drawing(version='1'), '1: version: is 1; allowed 2'),
    (drawing(version='2.0'), '1: version: must be a whole number, is 2.0; allowed 2'),
    (drawing(word='A'), "2: word: is 'A'; allowed small letters"),
    (
        drawing(word='[a]'),
        '2: word: must be a single value, is a sequence; allowed small letters',
    ),
    (
        drawing(word='2001-99-99'),
        "2: word: '2001-99-99' is no timestamp: month must be in 1..12",
    ),
    (
        drawing(shape='{sid_m: 1}'),
        f"3: shape: has none of side_m, radius_m; did you mean 'side_m'?{EITHER}",
    ),
    (drawing(shape='{side_m: 1, radius_m: 1}'), f'3: shape: has side_m and radius_m{EITHER}'),
    (
        drawing(shape='{radius_m: 1, cuont: 2}'),
        "3: shape.cuont: unknown key; did you mean 'count'?; allowed radius_m, count",
    ),
    (drawing(rest='marks: [[1, 2], [1]]'), '4: marks[1]: has 1 elements; allowed exactly 2'),
    (
        drawing(rest='marks: [[1, 2], [1, x]]'),
        "4: marks[1][1]: must be a number, is 'x'; allowed 0 to 10 m",
    ),
    (drawing(rest='word: b'), '4: word: appears twice'),
    (drawing(rest='[1]: b'), '4: a key must be one word'),
    (
        drawing(rest=f'marks: [{",".join("0" * (strict_yaml.MAX_ELEMENTS + 1))}]'),
        '4: marks: has 100001 elements; allowed at most 100000',
    ),
    ('version: 2\nword: a', '1: shape: is missing'),
    ('word: a\nshape: {side_m: 1}', '1: version: is missing; allowed 2'),
    ('[]', '1: must be a mapping, is a list'),
    ('', '1: the file is empty'),
    ('# only a comment\n', '1: the file is empty'),
    # a file that stands for gigabytes
    ('a: &a [x]\nb: [*a, *a]', '2: aliases (*a) are not allowed'),
    *[(opening * 20_000, '1: nests deeper than 32 levels') for opening in ('[', '{a: ', '- ')],
    *[
        (drawing(shape=f'\n  side_m: {number}'), f'4: shape.side_m: {what}; allowed 0 to 10 m')
        for number, what in {
            '.nan': 'must be finite, is .nan',
            '-.inf': 'must be finite, is -.inf',
            '1.0e999': 'must be finite, is 1.0e999',
            '11': 'is 11',
            '-1.0e-9': 'is -1.0e-9',
            'true': 'must be a number, is true',
            '"1"': "must be a number, is '1'",
            '': 'has no value',
            '~': "must be a number, is '~'",
            '1,5': "must be a number, is '1,5'",
            '0x' + 'f' * 5000: f'is 0x{"f" * 58}...',
        }.items()
    ],
]


@pytest.mark.parametrize(('text', 'message'), MISTAKES, ids=lambda value: value[-40:])
def test_a_mistake_names_file_line_key_and_what_is_allowed(text, message):
    with pytest.raises(YamlError) as caught:
        read(text)
    assert str(caught.value) == f'a.yaml:{message}'


def test_a_number_beyond_all_is_not_repeated_in_full():
    with pytest.raises(YamlError, match=r"^a.yaml:3: shape.side_m: '9{60}...' is no int: "):
        read(drawing(shape=f'{{side_m: {"9" * 5000}}}'))


@given(value=st.floats(0.0, 10.0), word=st.text(max_size=8))
def test_a_number_in_range_comes_back_and_any_text_is_a_value_or_a_named_error(value, word):
    assert read(drawing(shape=f'{{side_m: {value!r}}}')).shape.side_m == value
    try:
        made = read(drawing(word=word))
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


FILES = [
    share.path('msgs_yaml', 'topics.yaml'),
    share.path('mpcc_controller', 'config', 'mpcc.yaml'),
    share.path('vehicle_plant', 'config', 'bmw_545i.yaml'),
    share.path('scenario_publisher', 'scenarios', 'double_lane_change.yaml'),
]
WRONG = [
    'a: [1',
    'a: b: c',
    'a: "b',
    '\tb: 1',
    'a: @b',
    '- a\nb: 1',
    '{a: 1}}',
    '? [',
    'a:\t1\nb: [',
    'a: [1, 2\nb: 1\n',
    'name: \x07',
    'name: a\n---\nname: b\n',
]


@pytest.fixture
def each_parser(monkeypatch):
    """Return a function that calls another one with libyaml and without it."""

    def call(function, *arguments):
        results = []
        for fast in (strict_yaml._FAST, None):
            monkeypatch.setattr(strict_yaml, '_FAST', fast)
            strict_yaml._compose.cache_clear()
            results.append(function(*arguments))
        return results

    return call


def described(item):
    """Return the value of a node, and key and line of each in it."""
    if isinstance(item.node, strict_yaml.yaml.MappingNode):
        inner = [described(one) for one in item.items().values()]
    elif isinstance(item.node, strict_yaml.yaml.SequenceNode):
        inner = [described(one) for one in item.elements()]
    else:
        inner = item.value()
    return item.key, item.line, inner


@pytest.mark.parametrize('file', FILES, ids=lambda file: file.name)
def test_libyaml_gives_the_same_values_and_lines(each_parser, file):
    fast, slow = each_parser(lambda: described(strict_yaml.read(file)))
    assert fast == slow


# libyaml takes a tab before a value
TOLD = [*((text, 'no valid YAML') for text in WRONG), ('a:\t1\n', 'cannot start any token')]


@pytest.mark.parametrize(('text', 'words'), TOLD)
def test_a_mistake_is_told_in_the_same_words(each_parser, text, words, tmp_path):
    file = tmp_path / 'a.yaml'
    file.write_text(text)

    def told():
        with pytest.raises(strict_yaml.YamlError, match=words) as caught:
            strict_yaml.read(file)
        return str(caught.value)

    fast, slow = each_parser(told)
    assert fast == slow


@pytest.mark.parametrize(('name', 'what'), [('', 'Is a directory'), ('no.yaml', 'No such file')])
def test_a_file_that_cannot_be_read_is_named(tmp_path, name, what):
    file = tmp_path / name
    with pytest.raises(strict_yaml.YamlError, match=f'^{re.escape(str(file))}: {what}'):
        strict_yaml.read(file)


@pytest.mark.parametrize(
    ('key', 'line'), [('b', 2), ('b[1].x', 4), ('b[1].y', 4), ('b[7]', 2), ('c.d', 1)]
)
def test_the_error_about_a_key_names_the_nearest_line(key, line):
    root = strict_yaml.parse('a: 1\nb:\n  - {x: 1}\n  - {x: 2}\n', 'a.yaml')
    assert str(root.error_at(key, 'is odd')) == f'a.yaml:{line}: {key}: is odd'


@pytest.mark.parametrize('text', ['1e-6', '1.5e3', '.5E2'])
def test_an_exponent_without_a_dot_is_a_number_and_in_quotes_a_text(text, tmp_path):
    file = tmp_path / 'a.yaml'
    file.write_text(f'[{text}, "{text}"]')
    assert strict_yaml.read(file).value() == [float(text), text]
