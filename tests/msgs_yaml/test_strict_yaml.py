"""YAML is read as PyYAML's own parser reads it, also where libyaml does the work."""

import pytest

from msgs_yaml import share, strict_yaml

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


@pytest.mark.parametrize('text', ['a: [1, 2\nb: 1\n', 'name: \x07', 'name: a\n---\nname: b\n'])
def test_text_that_is_no_yaml_is_refused_with_its_line(text):
    with pytest.raises(strict_yaml.YamlError, match=r'^a.yaml:\d: no valid YAML'):
        strict_yaml.parse(text, 'a.yaml')


@pytest.mark.parametrize('text', ['', '# only a comment\n'])
def test_an_empty_file_is_refused(text):
    with pytest.raises(strict_yaml.YamlError, match=r'^a.yaml:1: the file is empty'):
        strict_yaml.parse(text, 'a.yaml')


def test_a_file_that_stands_for_gigabytes_is_refused_at_once():
    rows = ['a: &a [x, x]'] + [f'{c}: &{c} [*{b}, *{b}]' for b, c in zip('abcde', 'bcdef')]
    with pytest.raises(strict_yaml.YamlError, match=r'^a.yaml:2: aliases \(\*a\) are not allowed'):
        strict_yaml.parse('\n'.join(rows), 'a.yaml')


@pytest.mark.parametrize('opening', ['[', '{a: ', '- '])
def test_nesting_that_would_exhaust_the_stack_is_refused(opening):
    with pytest.raises(strict_yaml.YamlError, match=r'^a.yaml:1: nests deeper than 32 levels'):
        strict_yaml.parse(opening * 20_000, 'a.yaml')


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
