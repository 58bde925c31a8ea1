"""The rows of a study are its full grid of settings and draws. Mistakes: ../test_mistakes.py."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bags.errors import BagError
from experiments import drive_row
from experiments.batch import run_batch, study_file
from experiments.batch.study_file import Distribution
from experiments.drive_row import NOMINAL, SCENARIO_FRICTION, SCENARIO_SPEED
from experiments.families import draw as families
from msgs_yaml import share
from msgs_yaml.strict_yaml import read

MASS, LAG = 'plant.car.body.mass_kg', 'controller.tolerances.lag_m'
FOUR = {
    'a': Distribution('uniform', (-1.0, 3.0)),
    'b': Distribution('log_uniform', (0.1, 10.0)),
    'c': Distribution('normal', (0.0, 1.5), 1.0, 0.5),
    'd': Distribution('choice', ('x', 'y')),
}


def rows_of(path):
    study = study_file.load(path)
    rows = run_batch.rows_of(study, run_batch.combine(study))
    assert len(rows) == study.drives
    return rows


def test_the_grid_is_full_and_the_last_setting_changes_first(write_study):
    settings = {'plant.friction': [0.8, 1.0], 'scenario.speed_mps': [14, 15]}
    rows = rows_of(write_study(controllers=['mpcc', 'mpcc_no_ca'], set=settings))
    assert len(rows) == 16
    values = [(0.8, 14), (0.8, 15), (1.0, 14), (1.0, 15)]
    assert [tuple(dict(row.settings).values()) for row in rows[:8:2]] == values


def test_a_run_has_one_offset_for_every_controller_and_setting_the_first_none(write_study):
    rows = rows_of(write_study(controllers=['mpcc', 'mpcc_no_ca'], runs=4))
    by_run = {}
    for row in rows:
        by_run.setdefault(dict(row.labels)['run'], set()).add(row.offset)
    assert by_run[1] == {NOMINAL}
    assert [len(offsets) for offsets in by_run.values()] == [1] * 4
    assert len(set.union(*by_run.values())) == 4
    # more runs begin with those of fewer; another seed gives others; they fill their ranges
    offsets = run_batch.draw_offsets(61, seed=1)
    assert offsets[:3] == run_batch.draw_offsets(3, seed=1)
    assert not set(offsets[1:]) & set(run_batch.draw_offsets(61, seed=2))
    speed, grip = map(np.array, zip(*offsets[1:]))
    for values, spread in (
        (speed, run_batch.SPEED_SPREAD_KPH),
        (grip - 1, run_batch.GRIP_SPREAD),
    ):
        # no tenth of a range is left out, none is preferred: 6 +- 3 of 60
        counts, _ = np.histogram((values / spread + 1) / 2, bins=10, range=(0, 1))
        assert counts.sum() == 60
        assert 3 <= counts.min() <= counts.max() <= 9


def test_every_controller_and_setting_has_the_same_draws(write_study):
    given = {'families': ['pop_up', 'closed_road'], 'draws': 4, 'runs': 1}
    draw = {LAG: {'log_uniform': [0.1, 1.0]}}
    rows = rows_of(write_study(controllers=['mpcc', 'mpcc_no_ca'], draw=draw, **given))
    assert len(rows) == 12 * 4
    values = [dict(row.settings)[LAG] for row in rows]
    assert values == values[:4] * 12
    for row in rows[16:20]:
        setup = drive_row.prepare(row)
        assert setup.scn.text == families.draw('pop_up', 1, row.draw.index).text
        assert setup.params.tolerances.lag_m == dict(row.settings)[LAG]
        assert setup.friction == 0.8  # of `set`
    # without drawn values a scenario is driven once beside families
    rows = rows_of(write_study(**given))
    assert [row.draw is None for row in rows] == 2 * [True] + 16 * [False]


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


def test_files_are_found_from_the_folder_of_the_study(write_study, short_road, monkeypatch):
    (short_road.parent / 'other_road.yaml').write_text(short_road.read_text())
    monkeypatch.chdir('/')
    study = study_file.load(write_study(scenarios=['straight', './*_road.yaml', 'short_road.yaml']))
    other = short_road.with_name('other_road.yaml')
    assert study.scenarios == ('straight', str(other), str(short_road))
    assert study.drives == 3 * 1 * 2 * 2


def test_an_element_without_a_value_is_an_error(write_study):
    path = write_study(set={MASS: [1500, 'NOTHING']})
    path.write_text(path.read_text().replace('NOTHING', ''))
    with pytest.raises(BagError, match=rf'study.yaml:9: set.{MASS}\[1\]: has no value; allowed'):
        study_file.load(path)


@pytest.mark.parametrize('name', ['batch_example', 'robustness', 'speed_friction'])
def test_every_setting_and_draw_of_a_shipped_study_is_accepted(name):
    study = study_file.load(share.path('experiments', 'config', f'{name}.yaml'))
    combinations = run_batch.combine(study)
    run_batch.check_drawn(study, combinations)
    rows = sorted(run_batch.rows_of(study, combinations), key=lambda row: repr(row.settings))
    first, last = (drive_row.prepare(row) for row in (rows[0], rows[-1]))
    assert first != last
    if name == 'speed_friction':
        speeds = [dict(row.settings)[SCENARIO_SPEED] for row in rows]
        assert min(speeds) < 16.0 < 34.0 < max(speeds)
        friction = dict(rows[-1].settings)[SCENARIO_FRICTION]
        assert last.friction == last.params.model.friction == friction


def test_draws_follow_their_distributions_and_are_spread_evenly():
    """By the test of Kolmogorov and Smirnov against scipy; points of Sobol pass it by far."""
    draws = study_file.sample(FOUR, 1024, seed=3)
    expected = {
        'a': stats.uniform(-1.0, 4.0),
        'b': stats.loguniform(0.1, 10.0),
        'c': stats.truncnorm(-2.0, 1.0, 1.0, 0.5),
    }
    for name, distribution in expected.items():
        values = [draw[name] for draw in draws]
        assert stats.kstest(values, distribution.cdf).statistic < 0.01
    # a power of two has as many draws in every part
    few = study_file.sample(FOUR, 64, seed=9)
    for part in range(8):
        low = -1.0 + 4.0 * part / 8
        assert sum(low <= draw['a'] < low + 0.5 for draw in few) == 8
    assert sum(draw['d'] == 'x' for draw in few) == 32


@given(st.integers(0, 60), st.integers(0, 60), st.integers(0, 2**32 - 1))
def test_a_part_of_a_sample_is_that_part_of_a_longer_one(first, count, seed):
    longer = study_file.sample(FOUR, 128, seed)
    assert study_file.sample(FOUR, count, seed, first) == longer[first : first + count]
    assert not {one['a'] for one in longer} & {
        one['a'] for one in study_file.sample(FOUR, 8, seed + 1)
    }
    with pytest.raises(ValueError, match='allowed 0 to 1073741823'):
        study_file.sample(FOUR, 1, seed, first=study_file.MAX_DRAWS)


@given(
    st.floats(-1e3, 1e3),
    st.floats(1e-3, 1e3),
    st.floats(0.0, 1.0),
    st.floats(-3.0, 3.0),
    st.floats(0.01, 3.0),
)
def test_no_value_leaves_its_interval(low, width, share, offset_sds, sd):
    ends = low, low + width
    for kind in ('uniform', 'normal'):
        value = Distribution(kind, ends, low + offset_sds * sd, sd).value(share)
        assert ends[0] <= value <= ends[1]
    value = Distribution('log_uniform', (width, 7.0 * width)).value(share)
    assert width <= value <= 7.0 * width
    assert Distribution('choice', (1, 2, 3)).value(share) in (1, 2, 3)


@pytest.mark.parametrize(
    ('text', 'distribution'),
    [
        ('{uniform: [1, 2e0]}', ('uniform', (1.0, 2.0), 0.0, 1.0)),
        ('{log_uniform: [1e-3, 1]}', ('log_uniform', (0.001, 1.0), 0.0, 1.0)),
        ('{normal: [0.5, 2], within: [-1, 2]}', ('normal', (-1.0, 2.0), 0.5, 2.0)),
        ('{choice: [free, 2, true]}', ('choice', ('free', 2, True), 0.0, 1.0)),
    ],
)
def test_distributions_are_read(tmp_path, text, distribution):
    path = tmp_path / 'one.yaml'
    path.write_text(text)
    assert study_file.parse_distribution(read(path)) == distribution
