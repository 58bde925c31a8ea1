"""The reference pages hold everything that the source defines."""

import re
from functools import cache
from pathlib import Path

import pytest
import reference_pages
from reference_pages import (
    command_pages,
    launch_table,
    markdown,
    metric_page,
    parameter_pages,
    scenario_page,
    topic_page,
)

import bags.cli
import experiments.cli
from bags.evaluation.metrics.registry import Metric
from experiments.run import launch_arguments
from msgs_yaml import contract, share, strict_yaml
from node_runtime import node_parameters, parameters
from scenario_publisher import schema
from vehicle_plant.parameters import EXTRAS, NodeParams

ROOT = Path(__file__).parents[2]


@cache
def pages():
    return reference_pages.pages()


@pytest.mark.parametrize('kind', parameter_pages.KINDS, ids=lambda kind: kind.page)
def test_every_parameter_is_on_the_page_of_its_node(kind):
    rows = re.findall(r'^\| `([^`]+)` \|', pages()[kind.page], re.MULTILINE)
    assert rows == list(dict.fromkeys(rows))
    beside = {p.name for p in EXTRAS.parameters} if kind.cls is NodeParams else set()
    assert set(rows) == set(parameters.leaves(kind.cls)) | beside


def test_every_parameter_has_a_meaning_or_says_its_range():
    for kind in parameter_pages.KINDS:
        for row in re.findall(r'^\| `.*', pages()[kind.page], re.MULTILINE):
            assert len(row.strip('| ').split(' | ')) >= 3, row


def test_the_page_tells_which_parameters_may_be_set_while_driving():
    page = pages()['parameters_controller']
    assert re.search(r'\| `priorities.obstacle` \|.*\| yes \|', page)
    assert not re.search(r'\| `model.horizon` \|.*\| yes \|', page)


def test_parameters_of_every_node_have_a_page():
    page = pages()[parameter_pages.EVERY_NODE]
    assert all(f'`{name}`' in page for name in node_parameters.MANAGED)


def test_the_page_of_controllers_tells_what_a_file_changes():
    page = pages()[parameter_pages.CONTROLLERS]
    (section,) = re.findall(r'^## `mpcc_no_ca.yaml`\n(.*?)^## ', page, re.MULTILINE | re.DOTALL)
    assert 'Base: `mpcc.yaml`' in section
    assert re.search(r'\| `priorities.obstacle` \| 0.0 \| 1000.0 \|', section)
    assert '`model.horizon`' not in section


def test_every_shipped_controller_is_on_the_page():
    names = re.findall(r'^## `(.+)`', pages()[parameter_pages.CONTROLLERS], re.MULTILINE)
    files = share.path('mpcc_controller', 'config').glob('*.yaml')
    cars = {file.name for file in files if file.stem.startswith('car')}
    everything = {file.name for file in share.path('mpcc_controller', 'config').glob('*.yaml')}
    assert set(names) == everything - cars


def test_every_topic_and_field_is_on_the_page():
    page = topic_page.page()
    for topic in contract.load().topics.values():
        assert f'## `{topic.name}`' in page
        for path in topic.fields:
            assert f'| `{path}` |' in page


def test_every_metric_is_on_the_page():
    from bags.evaluation.metrics import registry

    rows = re.findall(r'^\| `(\w+)` \|', pages()['metrics'], re.MULTILINE)
    assert rows == [*registry.METRICS]


def test_a_metric_of_ones_own_is_on_the_page():
    def own_m(run):
        """Own | value."""

    page = metric_page.page([Metric(own_m, 'own', 'm/s²', 1, good_when=True)])
    assert '| `own_m` | own | m/s² | yes | Own \\| value. |' in page


def test_every_key_of_a_scenario_is_on_the_page():
    page = pages()['scenario_keys']
    for name, cls in scenario_page.blocks(schema.File).items():
        (body,) = re.findall(rf'^## {name}\n((?:(?!##).*\n)*)', page, re.MULTILINE)
        keys = re.findall(r'^\| `(\w+)` \|', body, re.MULTILINE)
        assert keys == list(strict_yaml.field_types(cls))


def test_the_blocks_of_a_scenario_are_found_in_lists_and_alternatives():
    names = set(scenario_page.blocks(schema.File))
    assert {'File', 'SegmentLine', 'Clothoid', 'WaypointObstacle', 'FrictionPatch'} <= names


@pytest.mark.parametrize('cli', [bags.cli, experiments.cli], ids=['bags', 'experiments'])
def test_the_help_of_every_command_is_on_its_page(cli):
    program = cli.__name__.partition('.')[0]
    page = pages()[f'commands_{program}']
    for command in cli.COMMANDS:
        (body,) = re.findall(rf'^## `{program} {command}`\n\n```text\n(.*?)```', page, re.M | re.S)
        assert body.startswith(f'usage: {program} {command} ')


def test_help_is_as_wide_on_every_terminal(monkeypatch):
    monkeypatch.setenv('COLUMNS', '30')
    said = command_pages.help_of(bags.cli.main, ('play',))
    assert max(map(len, said.splitlines())) > 60
    assert command_pages.os.environ['COLUMNS'] == '30'


def test_exit_codes_are_those_of_the_source():
    page = pages()['exit_codes']
    assert '| 78 | a wrong parameter' in page
    assert '| 130 | SIGINT' in page
    assert re.search(r'\| `experiments run` \| 1 \| ', page)


def test_the_page_about_launch_has_every_argument_as_it_is():
    block = launch_table.block()
    write = 'write it with: PYTHONPATH=docs/_extensions python -m reference_pages.launch_table'
    page = (ROOT / launch_arguments.PAGE).read_text()
    assert f'{launch_table.BEGIN}{block}{launch_table.END}' in page, write
    assert block.count('\n| `') == len(launch_arguments.ARGUMENTS)


def test_a_table_leaves_out_empty_columns_and_escapes_bars():
    text = markdown.table(('a', 'b', 'c'), [(markdown.code('x|y'), '', markdown.text('p|q_r'))])
    assert text == '| a | c |\n| --- | --- |\n| `x\\|y` | p\\|q\\_r |\n'
