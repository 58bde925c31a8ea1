"""The help of every command answers at once: it imports nothing that takes long."""

import subprocess
import sys

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
