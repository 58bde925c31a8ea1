"""The help of every command answers at once: it imports nothing that takes long, starts no ROS."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import bags.cli
import experiments.cli

PLANT = ('bokeh', 'matplotlib', 'pandas', 'pyarrow', 'rclpy', 'scipy')
SLOW = (*PLANT, 'casadi')  # it takes 10 ms beside numpy
SCRIPT = """
import contextlib, io, sys
from {module} import main
for words in {commands}:
    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()) as text:
        main([*words, '--help'])
    usage, program, *rest = text.getvalue().split()
    assert usage == 'usage:' and rest[: len(words)] == words, words
print([name for name in {slow} if name in sys.modules])
"""
NODES = (
    *('scenario_node', 'converter_node', 'controller_node', 'mpcc_node', 'frenet_node'),
    *('plant_node', 'estimator_node', 'markers_node', 'player_node', 'recorder_node'),
)
HELP_OF_NODES = """
import sys
from contextlib import suppress
from importlib.metadata import entry_points
programs = {{entry.name: entry for entry in entry_points(group='console_scripts')}}
for name in {nodes}:
    sys.argv = [name, '--help']
    with suppress(SystemExit):
        programs[name].load()()
"""


@pytest.mark.parametrize(
    ('module', 'commands', 'slow'),
    [
        ('bags.cli', [[], *([name] for name in bags.cli.COMMANDS)], SLOW),
        ('experiments.cli', [[], *([name] for name in experiments.cli.COMMANDS)], SLOW),
        ('vehicle_plant.manoeuvre', [[]], PLANT),
        ('vehicle_plant.identify', [[]], PLANT),
    ],
)
def test_help_of_a_program_and_its_commands_imports_nothing_slow(module, commands, slow):
    script = SCRIPT.format(module=module, commands=commands, slow=slow)
    done = subprocess.run(
        [sys.executable, '-c', script], capture_output=True, text=True, timeout=240
    )
    assert (done.stdout, done.stderr) == ('[]\n', '')


def test_every_node_prints_help_and_starts_no_ros():
    """Its domain does not exist: no ROS context can be made."""
    program = [sys.executable, '-c', HELP_OF_NODES.format(nodes=NODES)]
    environment = os.environ | {'ROS_DOMAIN_ID': 'none'}
    done = subprocess.run(program, capture_output=True, text=True, timeout=60, env=environment)
    assert (done.returncode, done.stderr) == (0, '')
    shown = re.split('^usage: ', done.stdout, flags=re.MULTILINE)[1:]
    assert [text.split()[0] for text in shown] == [*NODES]
    for name, text in zip(NODES, shown):
        assert 'experiments parameters' in text, name
        assert f'example:\n  {name} --' in text


def test_a_word_that_no_node_reads_starts_nothing():
    program = [Path(sys.executable).with_name('plant_node'), '--hlep']
    done = subprocess.run(program, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert 'unrecognized arguments: --hlep' in done.stderr
