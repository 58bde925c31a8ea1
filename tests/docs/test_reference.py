"""The reference holds everything that the source defines, and docstrings as authors see them."""

import ast
import re
from functools import cache
from pathlib import Path

import api_pages
import plain_docstrings
import pytest
import reference_pages
from installation import PACKAGES
from reference_pages import command_pages, markdown, parameter_pages
from reference_pages.scenario_page import blocks

import bags.cli
import experiments.cli
from bags.evaluation import metrics  # noqa: F401 - fills METRICS
from bags.evaluation.metrics.registry import METRICS
from experiments.run import launch_arguments
from msgs_yaml import contract, share, strict_yaml
from node_runtime import node_parameters, parameters
from scenario_publisher import schema
from vehicle_plant.parameters import EXTRAS, NodeParams

ROOT = Path(__file__).parents[2]
THEORY = (ROOT / 'docs/explanation/theory.md').read_text()
EQUATIONS = ('model', 'path', 'problem')  # folders of the controller's equations
CELL = re.compile(r'^\| `([^`]+)` \|', re.MULTILINE)


@cache
def pages():
    return reference_pages.pages()


def section(page, title):
    """Return the text below a heading."""
    (body,) = re.findall(rf'^## {re.escape(title)}\n((?:(?!## ).*\n)*)', pages()[page], re.M)
    return body


@pytest.mark.parametrize('kind', parameter_pages.KINDS, ids=lambda kind: kind.page)
def test_every_parameter_is_on_the_page_of_its_node_with_a_meaning_or_range(kind):
    rows = CELL.findall(pages()[kind.page])
    beside = {p.name for p in EXTRAS.parameters} if kind.cls is NodeParams else set()
    assert sorted(rows) == sorted({*parameters.leaves(kind.cls)} | beside)
    for row in re.findall(r'^\| `.*', pages()[kind.page], re.MULTILINE):
        assert len(row.strip('| ').split(' | ')) >= 3, row


def test_pages_of_parameters_tell_what_may_change_and_what_a_file_changes():
    page = pages()['parameters_controller']
    assert re.search(r'\| `priorities.obstacle` \|.*\| yes \|', page)
    assert not re.search(r'\| `model.horizon` \|.*\| yes \|', page)
    every = pages()[parameter_pages.EVERY_NODE]
    assert all(f'`{name}`' in every for name in node_parameters.MANAGED)
    files = {file.name for file in share.path('mpcc_controller', 'config').glob('*.yaml')}
    titles = re.findall(r'^## `(.+)`', pages()[parameter_pages.CONTROLLERS], re.MULTILINE)
    assert {*titles} == {name for name in files if not name.startswith('car')}
    changes = section(parameter_pages.CONTROLLERS, '`mpcc_no_ca.yaml`')
    assert 'Base: `mpcc.yaml`' in changes
    assert re.search(r'\| `priorities.obstacle` \| 0.0 \| [1-9][\d.]* \|', changes)
    assert '`model.horizon`' not in changes


def test_every_topic_field_metric_and_launch_argument_is_on_its_page():
    for topic in contract.load().topics.values():
        body = section('topics', f'`{topic.name}`')
        assert {*topic.fields} <= {*CELL.findall(body)}
    assert CELL.findall(pages()['metrics']) == [*METRICS]
    names = [argument.name for argument in launch_arguments.ARGUMENTS]
    assert CELL.findall(pages()['launch_arguments']) == names


def test_a_table_leaves_out_empty_columns_and_escapes_bars():
    text = markdown.table(('a', 'b', 'c'), [(markdown.code('x|y'), '', markdown.text('p|q_r'))])
    assert text == '| a | c |\n| --- | --- |\n| `x\\|y` | p\\|q\\_r |\n'


def test_every_key_of_a_scenario_is_on_the_page():
    names = blocks(schema.File)
    assert {'File', 'SegmentLine', 'Clothoid', 'WaypointObstacle', 'FrictionPatch'} <= {*names}
    for name, cls in names.items():
        body = section('scenario_keys', name)
        assert CELL.findall(body) == [*strict_yaml.field_types(cls)]
        assert name == 'Edges' or name.endswith('Segment') or '| key | meaning | value |' in body


@pytest.mark.parametrize('cli', [bags.cli, experiments.cli], ids=['bags', 'experiments'])
def test_the_help_of_every_command_is_on_its_page(cli, monkeypatch):
    program = cli.__name__.partition('.')[0]
    for command in cli.COMMANDS:
        body = section(f'commands_{program}', f'`{program} {command}`')
        assert body.startswith(f'\n```text\nusage: {program} {command} ')
    monkeypatch.setenv('COLUMNS', '30')  # it is as wide on every terminal
    assert max(map(len, command_pages.help_of(cli.main, ()).splitlines())) > 60


def test_exit_codes_are_those_of_the_source():
    page = pages()['exit_codes']
    assert '| 78 | a wrong parameter' in page
    assert '| 130 | SIGINT' in page
    assert re.search(r'\| `experiments run` \| 1 \| ', page)


def test_every_module_but_those_of_commands_has_a_place():
    files = {
        '.'.join(path.relative_to(ROOT / package).with_suffix('').parts)
        for package in PACKAGES
        for path in (ROOT / package / package).rglob('*.py')
        if path.name != '__init__.py' and path.parent.name != 'commands'
    }
    folders = api_pages.folders(ROOT)
    assert {module for modules in folders.values() for module in modules} == files
    assert {*PACKAGES} <= folders.keys()


def test_the_page_of_a_folder_that_is_no_more_is_removed(tmp_path):
    stale = tmp_path / api_pages.FOLDER / 'bags.gone.rst'
    stale.parent.mkdir(parents=True)
    stale.touch()
    api_pages.write_pages(ROOT, tmp_path)
    assert not stale.exists()
    assert stale.with_name('bags.rst').exists()


@pytest.mark.parametrize(
    ('text', 'rest'),
    [
        ('v_ is |x| of *args', 'v\\_ is \\|x\\| of \\*args\n'),
        ('the `a_b`s of x', 'the \\ ``a_b``\\ s of x\n'),
        ('    a: 1\n    b: 2', '.. code-block:: text\n\n   a: 1\n   b: 2\n'),
        ('name    x\nother   y', '.. code-block:: text\n\n   name    x\n   other   y\n'),
        ('a\nb\n\nc', 'a b\n\nc\n'),
        ('- a\n- b', '- a\n- b\n'),
    ],
)
def test_a_docstring_on_the_site_is_what_its_author_sees(text, rest):
    assert '\n'.join(plain_docstrings.to_rest(text.splitlines())) == rest


A_CAR = """
from dataclasses import dataclass
from typing import Annotated
from node_runtime.parameters import Range
@dataclass
class Car:
    mass: Annotated[float, Range(1.0, 9.0, 'kg')] | None  # with driver
    # behind the
    # front axle
    cog: float
    _hidden: int = 0
"""


def test_fields_have_type_range_and_comment(tmp_path, monkeypatch):
    (tmp_path / 'a_car.py').write_text(A_CAR)
    monkeypatch.syspath_prepend(tmp_path)
    import a_car

    assert plain_docstrings.class_fields(a_car)['Car'] == [
        ('mass', 'float | None', 'with driver; 1.0 to 9.0 kg'),
        ('cog', 'float', 'behind the front axle'),
    ]


def test_the_theory_page_has_every_equation_and_links_every_function_that_cites_the_paper():
    functions = {
        f'mpcc_controller.{folder}.{path.stem}.{node.name}'
        for folder in EQUATIONS
        for path in (ROOT / 'mpcc_controller/mpcc_controller' / folder).glob('*.py')
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.FunctionDef) and not node.name.startswith('_')
        if re.search(r"\(paper|paper's eq", ast.get_docstring(node) or '')
    }
    assert len(functions) > 10
    assert {name for name in functions if f'<{name}>' not in THEORY} == set()
    assert sorted(re.findall(r'\\tag\{(\d+)\}', THEORY)) == [*map(str, range(1, 8))]
