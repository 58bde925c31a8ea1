"""A study is read strictly: an error names file, line, field and what is allowed."""

import pytest

from bags.errors import BagError
from experiments import drive_row
from experiments.batch import study_file, study_rows
from experiments.drive_row import SCENARIO_FRICTION as FRICTION
from experiments.drive_row import SCENARIO_SPEED as SPEED
from msgs_yaml import share


@pytest.mark.parametrize(
    ('given', 'field', 'allowed'),
    [
        ({'schema': 2}, 'schema', 'allowed 1'),
        ({'run': 3}, 'run', r"did you mean 'runs'\?; allowed schema, scenarios"),
        ({'scenarios': 'straight'}, 'scenarios', 'must be a list'),
        ({'scenarios': []}, 'scenarios', 'at least one'),
        ({'scenarios': ['straight', 3]}, r'scenarios\[1\]', 'a name or a file'),
        ({'scenarios': ['./*.yml']}, r'scenarios\[0\]', 'fits no file'),
        ({'runs': 0}, 'runs', 'allowed 1 to 10000'),
        ({'runs': 1.5}, 'runs', 'a whole number'),
        ({'seed': -1}, 'seed', 'allowed 0 to'),
        ({'set': {'friction': [1.0]}}, 'set.friction', r'allowed plant\.\*, controller\.\*, '),
        ({'set': {'plant.friction': 1.0}}, 'set.plant.friction', 'must be a list'),
        ({'set': {'plant.friction': []}}, 'set.plant.friction', 'at least one'),
        ({'set': {'plant.stop.x_m': [9.0]}}, 'set.plant.stop.x_m', 'allowed plant.friction, plant'),
        ({'set': {'plant.friction': [{'a': 1}]}}, r'set.plant.friction\[0\]', 'allowed a number'),
        ({'difficulty': 'hard'}, 'difficulty', 'no effect without families'),
        ({'draws': 3}, 'draws', 'no effect without draw or families'),
        ({'families': ['pop_up']}, 'draws', 'is missing'),
        ({'families': ['popup'], 'draws': 3}, r'families\[0\]', 'allowed pop_up or'),
        ({'families': [], 'draws': 3}, 'families', 'at least one'),
        ({'scenarios': ['pop_up:3']}, r'scenarios\[0\]', 'is a draw of a family; allowed under'),
        ({'draw': {'plant.friction': {'uniform': [0.5, 1.0]}}}, 'draws', 'is missing'),
        (
            {'draw': {'plant.friction': {'uniform': [0.5, 1.0]}}, 'draws': 4},
            'draw.plant.friction',
            'is in set, too',
        ),
        (
            {'draw': {'plant.car.body.mass_kg': {'uniform': [1, 0]}}, 'draws': 4},
            'draw.plant.car.body.mass_kg.uniform',
            'low < high',
        ),
        (
            {'draw': {'scenario.speed_mps': {'uniform': [20, 101]}}, 'draws': 4},
            'draw.scenario.speed_mps',
            'is 101.0; allowed 1 to 100 m/s',
        ),
        (
            {'draw': {'friction': {'uniform': [0.5, 1.0]}}, 'draws': 4},
            'draw.friction',
            "did you mean 'scenario.friction'",
        ),
        (
            {'families': ['pop_up'], 'draws': 2, 'set': {'scenario.speed_mps': [20.0]}},
            'families',
            'without scenario.speed_mps',
        ),
        (
            {'set': {'scenario.speed_mps': [20.0, 200.0]}},
            r'set.scenario.speed_mps\[1\]',
            'allowed 1 to 100 m/s',
        ),
    ],
    ids=lambda value: str(value)[:40],
)
def test_an_error_names_the_field_and_what_is_allowed(write_study, given, field, allowed):
    path = write_study(**given)
    with pytest.raises(BagError, match=rf'{path}:\d+: {field}: .*{allowed}'):
        study_file.load(path)


@pytest.mark.parametrize('field', ['schema', 'scenarios', 'controllers'])
def test_a_missing_field_is_named(write_study, field):
    path = write_study()
    lines = path.read_text().splitlines(keepends=True)
    start = next(k for k, line in enumerate(lines) if line.startswith(field))
    end = start + 1 + sum(line.startswith('-') for line in lines[start + 1 : start + 2])
    path.write_text(''.join(lines[:start] + lines[end:]))
    with pytest.raises(BagError, match=f'{field}: is missing'):
        study_file.load(path)


@pytest.mark.parametrize(
    ('name', 'values', 'what'),
    [
        ('plant.friction', [1.0, 9.0], 'allowed 0.05 to 1.5'),
        ('controller.safety.obstacle_m', [0.5, -1.0], 'allowed 0.01 to 10 m'),
        ('controller.safety.obstacles_m', [0.5, 0.6], 'no such parameter'),
        ('plant.car.no_such', [1, 2], 'no such parameter'),
    ],
)
def test_a_value_that_a_node_refuses_is_located(write_study, name, values, what):
    study = study_file.load(write_study(set={'controller.tolerances.lag_m': [0.5], name: values}))
    combination = study_rows.combine(study)[1]
    with pytest.raises(BagError) as caught:
        drive_row.prepare(combination)
    located = str(study_rows.locate_error(study, combination, caught.value))
    assert located.startswith(f'{study.path}:')
    assert f': set.{name}[' in located
    assert what in located


def test_too_many_drives_are_refused(write_study):
    grid = {f'plant.car.{name}': list(range(100)) for name in 'abc'}
    with pytest.raises(BagError, match=r'2,000,000 drives; allowed at most'):
        study_file.load(write_study(set=grid))


def test_files_are_found_from_the_folder_of_the_study(write_study, short_road, monkeypatch):
    (short_road.parent / 'other_road.yaml').write_text(short_road.read_text())
    monkeypatch.chdir('/')
    study = study_file.load(write_study(scenarios=['straight', './*_road.yaml', 'short_road.yaml']))
    other = short_road.with_name('other_road.yaml')
    assert study.scenarios == ('straight', str(other), str(short_road))
    assert study.drives == 3 * 1 * 2 * 2


@pytest.mark.parametrize('name', ['batch_example', 'robustness'])
def test_every_setting_of_a_shipped_study_is_accepted(name):
    study = study_file.load(share.path('experiments', 'config', f'{name}.yaml'))
    first, *_, last = study_rows.combine(study)
    assert drive_row.prepare(first) != drive_row.prepare(last)


def test_every_draw_of_the_shipped_study_is_accepted():
    study = study_file.load(share.path('experiments', 'config', 'speed_friction.yaml'))
    combinations = study_rows.combine(study)
    study_rows.check_drawn(study, combinations)
    rows = sorted(study_rows.rows_of(study, combinations[:1]), key=lambda row: row.settings)
    slow, fast = (dict(row.settings) for row in (rows[0], rows[-1]))
    assert slow[SPEED] < 16.0 < 34.0 < fast[SPEED]
    setup = drive_row.prepare(rows[-1])
    assert setup.friction == setup.params.model.friction == fast[FRICTION]
