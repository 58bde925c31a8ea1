"""Run files: what they say, what is refused with its place, and that options win."""

import pytest
from rich.console import Console

from bags.errors import BagError
from experiments.configuration import node_config
from experiments.run import run_and_compare, run_file
from msgs_yaml import share

GOOD = """scenario: ./road.yaml
controllers: [mpcc, ./mine.yaml]
settings:
  plant.friction: 0.9
  controller.safety.obstacle_m: 5e-1
labels: [a, b]
"""


@pytest.fixture
def write(tmp_path):
    """Return write(text) -> path of a run file."""

    def write_file(text):
        path = tmp_path / 'run.yaml'
        path.write_text(text)
        return str(path)

    return write_file


def test_names_are_kept_and_files_are_found_from_the_folder_of_the_file(write, tmp_path):
    run = run_file.load(write(GOOD))
    assert run.scenario == str(tmp_path / 'road.yaml')
    assert run.controllers == ('mpcc', str(tmp_path / 'mine.yaml'))
    assert run.settings == {'plant': {'friction': 0.9}, 'controller': {'safety.obstacle_m': 0.5}}
    assert run.labels == ('a', 'b')


def test_options_win_over_the_file(write):
    run = run_file.load(write(GOOD))
    same = run_file.with_options(run, [], [], '')
    assert same == run
    other = run_file.with_options(run, ['frenet'], ['plant.friction=0.7', 'plant.seed=1'], '')
    assert other.controllers == ['frenet']
    assert other.labels == ()
    assert other.settings['plant'] == {'friction': 0.7, 'seed': 1}
    assert other.settings['controller'] == {'safety.obstacle_m': 0.5}
    assert run_file.with_options(run, [], [], 'c').labels == ('c',)
    for_all = run._replace(labels=('wet',))
    assert run_file.with_options(for_all, ['frenet'], [], '').labels == ('wet',)


def test_the_run_of_a_scenario_alone_is_by_mpcc():
    run = run_file.with_options(run_file.load('straight'), [], [], '')
    assert (run.scenario, run.controllers, run.settings) == ('straight', ('mpcc',), {})


def test_a_scenario_file_is_no_run_file():
    road = str(share.path('scenario_publisher', 'scenarios', 'straight.yaml'))
    assert run_file.load(road) == run_file.RunFile(road)


@pytest.mark.parametrize(
    ('text', 'what'),
    [
        ('controllers: [mpcc]\n', "run.yaml:1: key 'scenario' is missing"),
        ('scenario: straight\ncontroler: mpcc\n', 'run.yaml:2: controler: unknown key; did you me'),
        ('scenario: 3\n', 'run.yaml:1: scenario: must be a text, is 3; allowed a name or a file'),
        ('scenario: straight\ncontrollers: []\n', 'run.yaml:2: controllers: is empty; allowed at'),
        (
            'scenario: straight\nsettings:\n  plnt.friction: 1\n',
            r"run.yaml:3: settings.plnt.friction: is no setting; did you mean 'plant.friction'\?; "
            'allowed recorder.*',
        ),
        (
            'scenario: straight\nsettings: {plant.friction: {a: 1}}\n',
            'run.yaml:2: settings.plant.friction: is no parameter; allowed a number',
        ),
        (
            'scenario: straight\nlabels: [7]\n',
            r'run.yaml:2: labels\[0\]: must be a text, is 7; allowed 1 to 40',
        ),
        (
            'scenario: straight\ncontrollers: [mpcc, frenet, mpcc_road]\nlabels: [a, b]\n',
            'run.yaml:3: labels: has 2 labels; allowed 1 or 3',
        ),
    ],
)
def test_mistakes_are_located(write, text, what):
    with pytest.raises(BagError, match=what):
        run_file.load(write(text))


def test_a_value_out_of_range_is_located_in_the_file(write, tmp_path):
    path = write('scenario: straight\nsettings:\n  plant.friction: 9.0\n')
    request = run_and_compare.Request(path, [], 'lockstep', tmp_path / 'out', [], 60.0)
    with pytest.raises(BagError, match=r'run.yaml:3: settings.plant.friction.*allowed 0.05 to 1.5'):
        run_and_compare.run(request, Console())


def test_each_controller_may_have_its_label_and_appear_twice():
    controllers = node_config.find_controllers(['mpcc', 'mpcc', 'frenet'], ['a', 'b', 'a'])
    assert [controller.run_name for controller in controllers] == ['mpcc@a', 'mpcc@b', 'frenet@a']
