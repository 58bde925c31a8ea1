"""docs/bags.md says what the nodes take."""

import argparse
import re
from pathlib import Path

import pytest
import yaml

from bags import cli
from bags.commands import play
from msgs_yaml import share
from node_runtime import parameters

TEXT = (Path(__file__).parents[3] / 'docs/bags.md').read_text()
ROW = re.compile(r'^\| `(\w+)` \| ([^|]*) \|', re.MULTILINE)


@pytest.mark.parametrize('node', ['recorder', 'player'])
def test_every_parameter_is_documented_with_its_default(node):
    values = parameters.read_file(share.path('bags', 'config', f'{node}.yaml')).values
    table = TEXT.partition(f'| parameter of `{node}_node` |')[2].partition('\n\n')[0]
    output = {name: yaml.safe_load(default) for name, default in ROW.findall(table)}
    assert output == values


def test_every_option_of_play_is_a_parameter_and_documented(capsys):
    values = parameters.read_file(share.path('bags', 'config', 'player.yaml')).values
    parser = argparse.ArgumentParser()
    play.add_arguments(parser)
    assert vars(parser.parse_args(['bag'])).keys() == values.keys() - {'delay_s'}
    with pytest.raises(SystemExit):
        cli.main(['play', '--help'])
    for option in set(re.findall(r'--[a-z]+', capsys.readouterr().out)) - {'--help'}:
        assert f'`{option}`' in TEXT
