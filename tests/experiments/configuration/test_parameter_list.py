import json

import pytest

from bags.errors import BagError
from experiments import cli
from experiments.configuration import inputs, node_config, parameter_list
from node_runtime import parameters

EVERY = parameter_list.sections()


def rows(sections=EVERY):
    return {
        parameter_list.full_name(section, row): row
        for section in sections
        for group in section.groups
        for row in group.parameters
    }


def test_every_parameter_of_every_node_is_listed():
    expected = {
        f'{role}.{name}'
        for role, (cls, _) in inputs.LOADERS.items()
        for name in parameters.leaves(cls)
    }
    expected |= {f'plant.{name}' for name in inputs.PLANT_EXTRAS}
    assert expected <= rows().keys()


def test_every_parameter_has_a_meaning():
    assert [name for name, row in rows().items() if not row.meaning] == []


def test_where_the_car_starts_is_listed():
    start = rows()['plant.start.from']
    assert (start.default, start.allowed) == ('reference', 'reference or parameters')
    assert 'plant.plant_params' in rows()


def test_every_default_is_allowed():
    for name, row in rows().items():
        if row.default is not None and row.low is not None:
            values = row.default if isinstance(row.default, list | tuple) else [row.default]
            assert all(row.low <= value <= row.high for value in values), name


def test_defaults_are_those_of_the_controller(tmp_path):
    assert rows()['controller.priorities.obstacle'].default == 1000.0
    none = rows(parameter_list.sections('mpcc_no_ca'))
    assert none['controller.priorities.obstacle'].default == 0.0
    file = tmp_path / 'mine.yaml'
    file.write_text('/**:\n  ros__parameters:\n    base: mpcc.yaml\n    safety: {edge_m: 0.7}\n')
    mine = rows(parameter_list.sections(str(file)))
    assert mine['controller.safety.edge_m'].default == 0.7
    assert mine['controller.priorities.obstacle'].default == 1000.0


def test_words_are_searched_in_names_and_meanings():
    found = rows(parameter_list.search(EVERY, ['brake', 'share']))
    assert 'controller.limits.brake_front_share_max' in found
    assert 'plant.friction' not in found


def test_a_full_name_is_shown_alone():
    assert rows(parameter_list.search(EVERY, ['plant.friction'])).keys() == {'plant.friction'}


def test_the_closest_parameter_is_suggested():
    with pytest.raises(BagError, match="no parameter has 'contouing'; did you mean 'contouring_m'"):
        parameter_list.search(EVERY, ['contouing'])


def test_the_command_prints_what_set_takes(capsys):
    assert cli.main(['parameters', 'contouring_m', '--json']) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row['name'] == 'controller.tolerances.contouring_m'
    assert (row['low'], row['high'], row['unit']) == (0.001, 1000.0, 'm')
    role, _, name = row['name'].partition('.')
    assert role in node_config.ROLES
    assert name in parameters.leaves(inputs.LOADERS[role][0])


def test_the_command_prints_default_range_and_meaning(capsys):
    assert cli.main(['parameters', 'safety.edge_m']) == 0
    text = capsys.readouterr().out
    assert 'controller.safety.edge_m = 0.5  [0.01 to 10 m]' in text
    assert 'between a circle of the car and an edge' in text
