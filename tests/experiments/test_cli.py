"""The command `experiments` and its subcommands."""

from pathlib import Path

import pytest

from experiments import cli
from experiments.commands import run


def test_every_command_has_a_help_text(capsys):
    assert {'run', 'replay-check', 'resolve', 'study'} <= set(cli.COMMANDS)
    for command in cli.COMMANDS:
        with pytest.raises(SystemExit) as ended:
            cli.main([command, '--help'])
        assert ended.value.code == 0
        assert f'experiments {command}' in capsys.readouterr().out
    assert Path('bags', 'runs') == run.RUNS
