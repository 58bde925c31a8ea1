"""The rows of a study are its full grid; runs and draws are paired."""

import numpy as np
import pytest

from bags.errors import BagError
from experiments import drive_row
from experiments.batch import study_file, study_rows
from experiments.drive_row import NOMINAL
from experiments.families import draw as families

MASS = 'plant.car.body.mass_kg'


def rows_of(path):
    study = study_file.load(path)
    rows = study_rows.rows_of(study, study_rows.combine(study))
    assert len(rows) == study.drives
    return rows


def test_the_grid_is_full_and_the_last_setting_changes_first(write_study):
    settings = {'plant.friction': [0.8, 1.0], 'scenario.speed_mps': [14, 15]}
    rows = rows_of(write_study(controllers=['mpcc', 'mpcc_no_ca'], set=settings))
    assert len(rows) == 16
    assert [dict(row.settings) for row in rows[:8:2]] == [
        {'plant.friction': friction, 'scenario.speed_mps': speed}
        for friction in (0.8, 1.0)
        for speed in (14, 15)
    ]


def test_a_run_has_one_offset_for_every_scenario_controller_and_setting(write_study):
    rows = rows_of(write_study(controllers=['mpcc', 'mpcc_no_ca'], runs=4))
    by_run = {}
    for row in rows:
        by_run.setdefault(dict(row.labels)['run'], set()).add(row.offset)
    assert by_run[1] == {NOMINAL}
    assert [len(offsets) for offsets in by_run.values()] == [1] * 4
    assert len(set.union(*by_run.values())) == 4


def test_more_runs_begin_with_those_of_fewer_and_another_seed_gives_others():
    more = study_rows.draw_offsets(7, seed=1)
    assert more[:3] == study_rows.draw_offsets(3, seed=1)
    assert not set(more[1:]) & set(study_rows.draw_offsets(7, seed=2))


def test_offsets_fill_their_ranges_evenly():
    speed, grip = map(np.array, zip(*study_rows.draw_offsets(61, seed=1)[1:]))
    for values, spread in (
        (speed, study_rows.SPEED_SPREAD_KPH),
        (grip - 1, study_rows.GRIP_SPREAD),
    ):
        # no tenth of a range is left out, none is preferred: 6 +- 3 of 60
        counts, _ = np.histogram((values / spread + 1) / 2, bins=10, range=(0, 1))
        assert counts.sum() == 60
        assert counts.min() >= 3
        assert counts.max() <= 9


def test_every_controller_and_setting_has_the_same_draws(write_study):
    name = 'controller.tolerances.lag_m'
    rows = rows_of(
        write_study(
            controllers=['mpcc', 'mpcc_no_ca'],
            families=['pop_up', 'closed_road'],
            draw={name: {'log_uniform': [0.1, 1.0]}},
            draws=4,
            runs=1,
        )
    )
    assert len(rows) == 12 * 4
    values = [dict(row.settings)[name] for row in rows]
    assert values == values[:4] * 12
    for row in rows[16:20]:
        setup = drive_row.prepare(row)
        assert setup.scn.text == families.draw('pop_up', 1, row.draw.index).text
        assert setup.params.tolerances.lag_m == dict(row.settings)[name]
        assert setup.friction == 0.8  # of `set`


def test_a_batch_of_more_draws_or_later_ones_has_the_same_draws(write_study):
    def sampled(**given):
        draw = {MASS: {'uniform': [1500, 1700]}}
        rows = rows_of(write_study(draw=draw, set={}, runs=1, **given))
        # a limit takes as long to find as a run, and that of a drawn car serves no other drive
        assert not any(row.knows_limit for row in rows)
        return [dict(row.settings)[MASS] for row in rows]

    more = sampled(draws=16)
    assert more[:5] == sampled(draws=5)
    assert more[9:12] == sampled(draws=3, first_draw=9)
    assert not set(more) & set(sampled(draws=16, seed=2))


def test_a_scenario_without_drawn_values_is_driven_once_beside_families(write_study):
    rows = rows_of(write_study(families=['pop_up'], draws=7, runs=1))
    assert [row.draw is None for row in rows] == 2 * [True] + 14 * [False]


@pytest.mark.parametrize(
    ('name', 'distribution', 'what'),
    [
        ('plant.friction', {'uniform': [0.5, 9.0]}, r'9.0: .*allowed 0.05 to 1.5'),
        ('controller.safety.obstacle_m', {'log_uniform': [0.001, 1.0]}, 'allowed 0.01 to 10 m'),
        ('controller.no_such', {'uniform': [0, 1]}, 'no such parameter'),
        ('plant.command_delay_ms', {'choice': [0, 20, 0.5]}, '0.5: .*whole number'),
        ('plant.command_delay_ms', {'uniform': [0, 20]}, '0.0: .*whole number'),
    ],
)
def test_ends_that_a_node_refuses_are_located(write_study, name, distribution, what):
    study = study_file.load(write_study(set={}, draw={name: distribution}, draws=2))
    with pytest.raises(BagError, match=rf'study.yaml:\d+: draw.{name}: .*{what}'):
        study_rows.check_drawn(study, study_rows.combine(study))
