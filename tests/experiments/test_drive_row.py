"""A row is one drive: how it is prepared, and what its key depends on."""

import pytest

from bags.errors import BagError
from experiments import drive_row, simulation
from experiments.configuration import node_config
from experiments.drive_row import NOMINAL, Offset, Row
from experiments.families import draw as families
from msgs_yaml import share
from scenario_publisher import scenario

ROAD, POP_UP = Row('straight', 'mpcc'), Row('pop_up:0', 'mpcc', seed=1)
LOW = (('plant.friction', 0.9),)


def test_an_offset_changes_speed_and_grip_of_any_row_alike():
    for what, controller, friction in (
        ('double_lane_change', 'mpcc', 0.8),
        ('straight', 'frenet', 1.0),
    ):
        row = Row(what, controller, (('plant.friction', friction),))
        nominal, setup = (
            drive_row.prepare(row._replace(offset=o)) for o in (NOMINAL, Offset(0.3, 1.02))
        )
        assert setup.friction / friction == pytest.approx(1.02)
        assert setup.params == nominal.params
        speed_mps = nominal.scn.start.speed + 0.3 / 3.6
        driven = simulation.prepare(what, controller, speed_mps=speed_mps).scn
        assert setup.scn.start == pytest.approx(driven.start)
        assert setup.scn.reference.t == pytest.approx(driven.reference.t)
    dry, less = (
        drive_row.prepare(Row('split_mu:0', 'mpcc', offset=o)).scn.patches.friction
        for o in (NOMINAL, Offset(0.0, 0.98))
    )
    assert [value / before for value, before in zip(less, dry)] == pytest.approx([0.98])


@pytest.mark.parametrize(
    ('one', 'other'),
    [
        (ROAD, ROAD._replace(scenario='circle_20m')),
        (ROAD, ROAD._replace(controller='mpcc_no_ca')),
        (ROAD, ROAD._replace(settings=LOW)),
        (ROAD._replace(settings=LOW), ROAD._replace(settings=(('plant.friction', 0.91),))),
        (ROAD, ROAD._replace(settings=(('controller.tolerances.lag_m', 0.4),))),
        (ROAD, ROAD._replace(settings=(('scenario.speed_mps', 15.5),))),
        (ROAD, ROAD._replace(offset=Offset(0.1, 1.0))),
        (ROAD, ROAD._replace(offset=Offset(0.0, 1.01))),
        (ROAD, ROAD._replace(knows_limit=False)),
        (
            ROAD._replace(settings=(('plant.tyre_set', 'tyre_205_60r15.yaml'),)),
            ROAD._replace(settings=(('plant.tyre_set', 'tyre_245_40r18.yaml'),)),
        ),
        (POP_UP, ROAD),
        (POP_UP, POP_UP._replace(scenario='pop_up:1')),
        (POP_UP, POP_UP._replace(scenario='closed_road:0')),
        (POP_UP, POP_UP._replace(seed=2)),
        (POP_UP, POP_UP._replace(difficulty='hard')),
        (POP_UP, Row('pop_up', 'mpcc')),
    ],
)
def test_the_key_depends_on_what_decides_a_row(one, other):
    assert drive_row.key(one) == drive_row.key(one._replace(labels=(('run', 2),)))
    assert drive_row.key(one) != drive_row.key(other)


def test_a_setting_that_is_a_file_decides_by_its_content(tmp_path):
    """The same path may hold another car tomorrow."""
    car = tmp_path / 'car.yaml'
    shipped = share.path('mpcc_controller', 'config', 'car.yaml').read_text()
    (line,) = (line for line in shipped.splitlines() if 'mass_kg' in line)
    row = ROAD._replace(settings=(('controller.car_file', str(car)),))
    keys = []
    for heavier in ('', '1'):
        car.write_text(shipped.replace(line, line.replace('mass_kg: 1', f'mass_kg: {heavier}1')))
        drive_row.forget_files()
        keys.append(drive_row.key(row))
    assert shipped != car.read_text()
    assert len(set(keys)) == 2


def test_a_row_whose_files_have_changed_since_its_key_is_not_driven(tmp_path):
    shipped = node_config.find_controller('mpcc').config
    own = tmp_path / 'own.yaml'
    own.write_text(shipped.read_text())
    row = POP_UP._replace(controller=str(own))
    wanted = drive_row.key(row)
    own.write_text(shipped.read_text().replace('path_search_m: 10', 'path_search_m: 11'))
    with pytest.raises(BagError, match='pop_up:0: a file of its inputs has changed since'):
        drive_row.drive_unchanged(row, wanted)


def test_a_file_that_is_called_like_a_controller_of_the_package_has_rows_of_its_own(tmp_path):
    paths = [str(tmp_path / f'{name}.yaml') for name in ('own', 'mpcc_road')]
    rows = [POP_UP._replace(controller=name) for name in ('mpcc_road', *paths)]
    assert [row.columns()['controller'] for row in rows] == ['mpcc_road', 'own', paths[1]]


def test_all_that_tells_a_row_apart_is_in_its_columns():
    row = POP_UP._replace(
        settings=(*LOW, ('controller.list', (1, 2))), offset=Offset(0.1, 1.01), labels=(('run', 3),)
    )
    assert row.columns() == {
        'scenario': 'pop_up:0',
        'family': 'pop_up',
        'difficulty': 'nominal',
        'seed': 1,
        'draw': 0,
        'controller': 'mpcc',
        'plant.friction': 0.9,
        'controller.list': [1, 2],
        'run': 3,
        'offset.speed_kph': 0.1,
        'offset.grip': 1.01,
    }


def test_given_settings_win_over_those_of_a_hard_draw():
    hard = POP_UP._replace(difficulty='hard', settings=(('controller.model.friction', 0.7),))
    one = families.draw('pop_up', 1, 0, 'hard')
    setup = drive_row.prepare(hard)
    assert setup.params.model.friction == 0.7
    wanted = one.settings['controller']['measurement_errors.left_bias_m']
    assert setup.params.measurement_errors.left_bias_m == wanted != 0.0
    assert setup.friction == scenario.parse(one.text, 'a.yaml').friction
