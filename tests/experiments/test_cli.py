"""The command `experiments` and its subcommands."""

from pathlib import Path

import pytest

from bags import cli as bags_cli
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


@pytest.mark.parametrize(
    ('words', 'meant'),
    [
        ('rnu straight', 'run'),
        ('run straight --contoller mpcc', '--controller'),
        ('resolve bag --at closst', 'closest'),
        ('library --difficulty hrd', 'hard'),
    ],
)
def test_a_misspelt_command_option_or_choice_is_answered_with_the_closest_one(capsys, words, meant):
    with pytest.raises(SystemExit) as ended:
        cli.main(words.split())
    assert ended.value.code == 2
    assert capsys.readouterr().err.endswith(f"; did you mean '{meant}'?\n")


@pytest.mark.parametrize(
    ('words', 'meant'),
    [
        ('run strait', 'straight'),
        ('run straight --controller mpc', 'mpcc'),
        ('run straight --controller frenet.yaml', 'frenet'),
        ('run ./raod.yml', 'road.yaml'),
        ('run straight --controller ./raod.yaml', 'road.yaml'),
        ('run straight --set controller.tolerances.contorting_m=1', 'tolerances.contouring_m'),
        ('library --family popup --out x', 'pop_up'),
        ('parameters contoring', 'contouring_m'),
    ],
)
def test_a_misspelt_name_is_answered_with_the_closest_one(
    tmp_path, monkeypatch, capsys, words, meant
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'road.yaml').touch()
    assert cli.main(words.split()) == 1
    assert f"did you mean '{meant}'" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ['road.yaml']


def test_another_word_for_a_command_is_answered_with_the_command(capsys):
    for program in (cli, bags_cli):
        for word, command in program.MEANT.items():
            with pytest.raises(SystemExit):
                program.main([word])
            assert f'; did you mean {command!r}?' in capsys.readouterr().err
            name, _, known = command.partition(' ')
            assert known in {'bags': bags_cli, 'experiments': cli}[name].COMMANDS
