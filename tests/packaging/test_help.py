"""The help of every command answers at once: it imports nothing that takes long."""

import configparser
import os
import subprocess
import sys
from pathlib import Path

import pytest

import bags.cli
import experiments.cli

SLOW = (
    'bokeh',
    'matplotlib',
    'matplotlib.figure',
    'optuna',
    'pyarrow',
    'rclpy',
    'scipy.interpolate',
    'scipy.optimize',
    'scipy.spatial',
    'scipy.stats',
)
SCRIPT = """
import contextlib, io, sys
from {module} import main
for words in {commands}:
    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()) as text:
        main([*words, '--help'])
    assert text.getvalue().startswith('usage: '), words
print([name for name in {slow} if name in sys.modules])
"""


def console_scripts(file):
    """Return the names of the programs that a setup.cfg installs."""
    config = configparser.ConfigParser(delimiters='=')
    config.read(file)
    lines = config.get('options.entry_points', 'console_scripts', fallback='').split('\n')
    return [line.partition('=')[0].strip() for line in lines if line]


def slow_imports_of_help(module, commands, slow):
    script = SCRIPT.format(module=module, commands=commands, slow=slow)
    command = [sys.executable, '-c', script]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240)
    assert not done.stderr
    return done.stdout


@pytest.mark.parametrize('cli', [bags.cli, experiments.cli], ids=['bags', 'experiments'])
def test_help_of_a_program_and_its_commands_imports_nothing_slow(cli):
    commands = [[], *([name] for name in cli.COMMANDS)]
    assert slow_imports_of_help(cli.__name__, commands, (*SLOW, 'casadi')) == '[]\n'


@pytest.mark.parametrize('name', ['manoeuvre', 'identify'])
def test_help_of_the_plant_imports_nothing_slow(name):
    """CasADi takes 10 ms beside numpy."""
    assert slow_imports_of_help(f'vehicle_plant.{name}', [[]], SLOW) == '[]\n'


ROOT = Path(__file__).parents[2]
NODES = [
    name
    for file in sorted(ROOT.glob('*/setup.cfg'))
    for name in console_scripts(file)
    if name.endswith('_node')
]


def run_node(name, *words):
    """Run the program of a node where no ROS context can be made: its domain does not exist."""
    program = Path(sys.executable).with_name(name)
    environment = {**os.environ, 'ROS_DOMAIN_ID': 'none'}
    return subprocess.run(
        [program, *words], capture_output=True, text=True, timeout=60, env=environment
    )


@pytest.mark.parametrize('name', NODES)
def test_a_node_prints_help_and_starts_no_ros(name):
    done = run_node(name, '--help')
    assert (done.returncode, done.stderr) == (0, '')
    assert done.stdout.startswith(f'usage: {name} ')
    assert 'experiments parameters' in done.stdout
    assert f'example:\n  {name} --' in done.stdout


@pytest.mark.parametrize('name', NODES)
def test_a_word_that_no_node_reads_starts_nothing(name):
    done = run_node(name, '--hlep')
    assert done.returncode == 2
    assert 'unrecognized arguments: --hlep' in done.stderr


def test_what_every_node_takes_is_described_in_words(capsys):
    assert experiments.cli.main(['parameters', 'mode']) == 0
    printed = capsys.readouterr().out
    assert 'NODE.mode = lockstep' in printed
    assert 'typing' not in printed
