import pytest

from scenario_publisher import scenario_file
from scenario_publisher.scenario_file import ScenarioError


def refusal(text):
    with pytest.raises(ScenarioError) as caught:
        scenario_file.parse_yaml(text, 'a.yaml')
    return str(caught.value)


def test_text_that_is_no_yaml_is_refused_with_its_line():
    assert refusal('name: a\nroad: [1, 2\n').startswith('a.yaml:3: no valid YAML: ')


def test_control_characters_are_refused():
    assert refusal('name: \x07').startswith('a.yaml')


@pytest.mark.parametrize('text', ['', '# only a comment\n'])
def test_empty_file_is_refused(text):
    assert refusal(text) == 'a.yaml: is empty'


def test_two_documents_in_a_file_are_refused():
    assert 'a.yaml:2: no valid YAML' in refusal('name: a\n---\nname: b\n')


def test_file_that_stands_for_gigabytes_is_refused_at_once():
    rows = ['a: &a [x, x]'] + [f'{c}: &{c} [*{b}, *{b}]' for b, c in zip('abcde', 'bcdef')]
    assert refusal('\n'.join(rows)) == 'a.yaml:2: aliases (*a) are not allowed'


@pytest.mark.parametrize('opening', ['[', '{a: ', '- '])
def test_nesting_that_would_exhaust_the_stack_is_refused(opening):
    assert 'nests deeper than 32 levels' in refusal(opening * 20_000)


def test_missing_file_and_folder_are_refused(tmp_path):
    for path in (tmp_path / 'none.yaml', tmp_path):
        with pytest.raises(ScenarioError, match=str(path)):
            scenario_file.read(path)


def test_binary_file_is_refused(tmp_path):
    path = tmp_path / 'a.yaml'
    path.write_bytes(b'\x89PNG\xff\xfe')
    with pytest.raises(ScenarioError, match=r'is no UTF-8 text'):
        scenario_file.read(path)


def test_huge_file_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / 'a.yaml'
    with path.open('wb') as file:
        file.truncate(scenario_file.MAX_BYTES + 1)
    with pytest.raises(ScenarioError, match=r'allowed at most 8000000 bytes'):
        scenario_file.read(path)


@pytest.mark.parametrize(
    ('key', 'line'), [('b', 2), ('b[1].x', 4), ('b[1].y', 4), ('b[7]', 2), ('c.d', 1)]
)
def test_error_about_a_key_names_the_nearest_line(key, line):
    root = scenario_file.parse_yaml('a: 1\nb:\n  - {x: 1}\n  - {x: 2}\n', 'a.yaml')
    assert str(scenario_file.error_at(root, key, 'is odd')) == f'a.yaml:{line}: {key}: is odd'
