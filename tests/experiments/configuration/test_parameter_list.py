"""`experiments parameters` lists what --set takes, with default, range, unit and meaning."""

import json

from experiments import cli
from experiments.configuration import inputs, parameter_list
from node_runtime import parameters


def rows(sections):
    return {
        parameter_list.full_name(section, row): row
        for section in sections
        for group in section.groups
        for row in group.parameters
    }


def test_every_parameter_of_every_node_is_listed_with_a_meaning_and_an_allowed_default(tmp_path):
    every = rows(parameter_list.sections())
    expected = {
        f'{role}.{name}'
        for role, (cls, _) in inputs.LOADERS.items()
        for name in parameters.leaves(cls)
    }
    assert expected | {f'plant.{name}' for name in inputs.PLANT_EXTRAS} <= every.keys()
    assert [name for name, row in every.items() if not row.meaning] == []
    start = every['plant.start.from']
    assert (start.default, start.allowed) == ('reference', 'reference or parameters')
    for name, row in every.items():
        if row.default is not None and row.low is not None:
            values = row.default if isinstance(row.default, list | tuple) else [row.default]
            assert all(row.low <= value <= row.high for value in values), name
    # the defaults are those of the controller that is asked for
    none = rows(parameter_list.sections('mpcc_no_ca'))
    mine = tmp_path / 'mine.yaml'
    mine.write_text('/**:\n  ros__parameters:\n    base: mpcc.yaml\n    safety: {edge_m: 0.7}\n')
    own = rows(parameter_list.sections(str(mine)))
    priorities = [one['controller.priorities.obstacle'].default for one in (every, none, own)]
    assert priorities[0] == priorities[2] > priorities[1] == 0.0
    assert own['controller.safety.edge_m'].default == 0.7


def test_words_are_searched_in_names_and_meanings_and_a_full_name_is_shown_alone(capsys):
    every = parameter_list.sections()
    brakes = rows(parameter_list.search(every, ['brake', 'share']))
    assert 'controller.limits.brake_front_share_max' in brakes
    assert 'plant.friction' not in brakes
    assert rows(parameter_list.search(every, ['plant.friction'])).keys() == {'plant.friction'}
    assert cli.main(['parameters', 'contouring_m', '--json']) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row['name'] == 'controller.tolerances.contouring_m'
    assert (row['low'], row['high'], row['unit']) == (0.001, 1000.0, 'm')
    assert cli.main(['parameters', 'safety.edge_m']) == 0
    text = capsys.readouterr().out
    assert 'controller.safety.edge_m = 0.5  [0.01 to 10 m]' in text
    assert 'between a circle of the car and an edge' in text


def test_what_every_node_takes_is_described_in_words(capsys):
    assert cli.main(['parameters', 'mode']) == 0
    text = capsys.readouterr().out
    assert 'NODE.mode = lockstep' in text
    assert 'typing' not in text
