"""`experiments table` and `plot`: shares, quantiles, pairs, and a surface of success."""

import math

import numpy as np
import pandas
import pytest

from bags.errors import BagError
from experiments import cli, drive_figures, drive_table

DRAWS, RUNS = 200, 2


@pytest.fixture(scope='session')
def true_share():
    """Return the share of drives that survive, which falls with speed and grows with friction."""
    return lambda speed, friction: 1 / (1 + np.exp(0.8 * (speed - 12.0 - 14.0 * friction)))


@pytest.fixture(scope='session')
def rows(true_share):
    """Return drives of two controllers: the second keeps 0.1 m more, whatever the draw."""
    rng = np.random.default_rng(7)
    speed, friction = rng.uniform(14.0, 30.0, DRAWS), rng.uniform(0.4, 1.0, DRAWS)
    survived = rng.random(DRAWS) < true_share(speed, friction)
    clearance = rng.normal(0.5, 0.2, DRAWS)
    one = pandas.DataFrame({'draw': np.arange(DRAWS), 'speed': speed, 'friction': friction})
    parts = []
    for controller, more in (('a', 0.0), ('b', 0.1)):
        for run in range(1, RUNS + 1):
            part = one.assign(
                scenario='road',
                controller=controller,
                family=None,
                run=run,
                error='',
                survived=survived.astype(object),
                clearance_m=clearance + more + 0.01 * rng.standard_normal(DRAWS),
                lost_by=np.where(survived, None, 'collision'),
            )
            parts.append(part)
    table = pandas.concat(parts, ignore_index=True)
    before = ['scenario', 'controller', 'family', 'draw', 'speed', 'friction', 'run', 'error']
    table = table[[*before, *(name for name in table if name not in before)]]
    table.loc[0, ['error', 'survived']] = ['its process ended', None]
    table.loc[[0, 1], 'clearance_m'] = np.nan
    return table


@pytest.fixture
def folder(tmp_path, rows):
    """Return the folder of the table."""
    rows.to_parquet(tmp_path / 'results.parquet')
    return tmp_path


@pytest.fixture
def table(folder):
    return drive_table.load(folder)


Z = 1.959964  # of the normal distribution, 95 %
SPEED, FRICTION = ('--by', 'speed'), ('--by', 'friction')


def of_pair(table, metric='clearance_m', pair=('b', 'a'), **changes):
    return drive_table.compare(table._replace(**changes), metric, pair).iloc[0]


def test_drives_without_a_result_are_left_out_and_draws_are_units(table, rows, folder):
    assert (len(table.rows), table.failed) == (len(rows) - 1, 1)
    assert table.inputs == ('scenario', 'controller', 'family', 'draw', 'speed', 'friction', 'run')
    assert table.units(table.rows).nunique() == table.rows['draw'].nunique()
    assert len(drive_table.load(folder / 'results.parquet').rows) == 799
    # where nothing is drawn runs are what is resampled
    few = table.rows[table.rows['draw'] < 20].copy()
    few['run'] = few['run'] + 2 * (few['draw'] % 5)
    undrawn = table._replace(
        rows=few.drop(columns='draw'), inputs=tuple(n for n in table.inputs if n != 'draw')
    )
    assert undrawn.units(undrawn.rows).nunique() == 10
    few['draw'] = few['draw'].where(few['draw'] < 10)
    assert table.units(few).nunique() == 10 + few[few['draw'].isna()]['run'].nunique()


def test_a_folder_without_a_usable_table_is_an_error(tmp_path, rows):
    file = tmp_path / 'results.parquet'
    for write, message in (
        (lambda: file.write_text('no table'), 'no table'),
        (lambda: rows.drop(columns='error').to_parquet(file), "no column 'error'"),
        (lambda: rows.assign(error='lost').to_parquet(file), 'no drive has a result'),
    ):
        write()
        with pytest.raises(BagError, match=message):
            drive_table.load(tmp_path)
    # lists are groups by their text
    split = [[0.5, 0.5] if run == 1 else [0.4, 0.6] for run in rows['run']]
    rows.assign(split=split)[['split', *rows]].to_parquet(file)
    assert set(drive_table.load(tmp_path).rows['split']) == {'[0.5, 0.5]', '[0.4, 0.6]'}


def test_shares_have_wilsons_interval_and_numbers_quantiles(table):
    of = table.rows['controller']
    held = table.rows[of == 'b']['survived']
    row = drive_table.summarise(table, 'survived', ['controller']).set_index('controller').loc['b']
    n, p = len(held), held.mean()
    middle = (p + Z**2 / (2 * n)) / (1 + Z**2 / n)
    half = Z / (1 + Z**2 / n) * math.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2))
    assert (row['drives'], row['missing']) == (n, 0)
    expected = p, middle - half, middle + half
    assert (row['share'], row['low'], row['high']) == pytest.approx(expected)
    values = table.rows[of == 'a']['clearance_m'].dropna()
    row = (
        drive_table.summarise(table, 'clearance_m', ['controller']).set_index('controller').loc['a']
    )
    assert (row['drives'], row['missing']) == (len(values) + 1, 1)
    for name, share in (('q05', 0.05), ('median', 0.5), ('q95', 0.95)):
        assert row[name] == pytest.approx(np.quantile(values, share))


def test_many_numbers_are_grouped_by_equal_counts_and_every_drive_is_in_one_cell(table):
    by_speed = drive_table.summarise(table, 'survived', ['speed'], bins=4)
    assert len(by_speed) == 4
    assert by_speed['drives'].max() - by_speed['drives'].min() <= 4
    assert by_speed['share'].is_monotonic_decreasing
    assert list(drive_table.summarise(table, 'survived', ['run'])['run']) == [1, 2]
    cells = drive_table.summarise(table, 'survived', ['speed', 'friction'], bins=3)
    assert (len(cells), cells['drives'].sum()) == (9, len(table.rows))


def test_a_constant_difference_is_found_though_draws_differ_far_more(table):
    result, swapped = of_pair(table), of_pair(table, pair=('a', 'b'))
    assert result['mean'] == pytest.approx(0.1, abs=0.003)
    assert result['low'] < 0.1 < result['high'] < 0.105
    # one drive has no result, one no value
    assert (result['pairs'], result['greater'], swapped['less']) == (398, 398, 398)
    assert swapped['mean'] == pytest.approx(-result['mean'])
    equal = drive_table.compare(table, 'survived', ('b', 'a'), by=['run'])
    assert list(equal['mean']) == [0.0, 0.0]
    assert list(equal['greater'] + equal['less']) == [0, 0]


def test_repeats_of_a_draw_and_settings_with_the_same_draws_do_not_narrow_an_interval(table):
    rows = table.rows[(table.rows['run'] == 1) & (table.rows['draw'] > 1)].copy()
    is_b = rows['controller'] == 'b'
    rows.loc[is_b, 'clearance_m'] += np.random.default_rng(1).normal(0.0, 1.0, is_b.sum())
    once = of_pair(table, rows=rows)
    for name, inputs in (('run', table.inputs), ('gain', ('gain', *table.inputs))):
        copies = pandas.concat(
            [rows.assign(**{name: number}) for number in range(1, 21)], ignore_index=True
        )
        often = of_pair(table, rows=copies, inputs=inputs)
        assert often['pairs'] == 20 * once['pairs']
        assert often['high'] - often['low'] == pytest.approx(once['high'] - once['low'], rel=0.1)


@pytest.fixture(scope='module')
def points():
    rng = np.random.default_rng(11)
    return rng.uniform(14.0, 30.0, 400), rng.uniform(0.4, 1.0, 400)


def test_a_surface_is_near_the_true_share_with_an_interval_that_copies_do_not_narrow(
    points, true_share, monkeypatch
):
    monkeypatch.setattr(drive_figures, 'RESAMPLES', 60)
    x, y = points
    holds = np.random.default_rng(2).random(400) < true_share(x, y)
    surface = drive_figures.fit_surface(x, y, holds, range(400))
    truth = true_share(*np.meshgrid(surface.x, surface.y))
    assert surface.skill > 0.3
    assert np.abs(surface.share - truth).max() < 0.2
    assert np.abs(surface.share - truth).mean() < 0.05
    assert np.mean((surface.low <= truth) & (truth <= surface.high)) > 0.75
    assert (surface.low <= surface.high).all()
    few = [part[:100] for part in (x, y, holds)]
    one = drive_figures.fit_surface(*few, range(100))
    many = drive_figures.fit_surface(*(np.tile(part, 5) for part in few), [*range(100)] * 5)
    width, width_many = ((s.high - s.low).mean() for s in (one, many))
    assert width_many > 0.7 * width
    unrelated = np.random.default_rng(5).random(400) < 0.5
    assert drive_figures.fit_surface(x, y, unrelated, range(400)).skill < 0.03
    with pytest.raises(BagError, match='share one draw or run'):
        drive_figures.fit_surface(x, y, holds, [7] * 400)


@pytest.mark.parametrize('count', [3, 397])
def test_where_nearly_all_agree_there_is_nothing_to_fit(points, count):
    with pytest.raises(BagError, match=f'{count} of 400 drives fulfil'):
        drive_figures.fit_surface(*points, np.arange(400) < count, range(400))


def test_tables_are_shown_and_written(folder, tmp_path, capsys):
    csv, markdown = tmp_path / 'new/table.csv', tmp_path / 'table.md'
    files = ('--csv', str(csv), '--markdown', str(markdown))
    assert cli.main(['table', str(folder), '--by', 'controller', *SPEED, *files]) == 0
    said = capsys.readouterr().out
    assert '1 drives without a result are left out' in said
    assert 'repeats of others' in said
    written = pandas.read_csv(csv)
    assert list(written)[:4] == ['controller', 'speed', 'drives', 'missing']
    assert written['drives'].sum() == 799
    lines = markdown.read_text().splitlines()
    assert len(lines) == 2 + len(written)
    assert lines[0].startswith('| controller | speed | drives |')
    assert cli.main(['table', str(folder), '--metric', 'clearance_m', '--pair', 'b', 'a']) == 0
    said = capsys.readouterr().out
    assert 'clearance_m of b minus a' in said
    assert '398' in said


@pytest.mark.parametrize(
    'words',
    [(*SPEED, *FRICTION), ('--metric', 'clearance_m', *SPEED, '--by', 'controller')],
    ids=' '.join,
)
def test_a_figure_is_written_as_png_and_svg(folder, tmp_path, words):
    stem = tmp_path / 'figures/one'
    assert cli.main(['plot', str(folder), *words, '--out', str(stem)]) == 0
    assert stem.with_suffix('.png').read_bytes().startswith(b'\x89PNG')
    assert '</svg>' in stem.with_suffix('.svg').read_text()


def test_a_controller_whose_drives_all_agree_has_no_surface(folder, rows, capsys, monkeypatch):
    monkeypatch.setattr(drive_figures, 'RESAMPLES', 10)
    command = ['plot', str(folder), *SPEED, *FRICTION, '--surface']
    all_held = rows['survived'].where(rows['controller'] == 'a', True)
    rows.assign(survived=all_held).to_parquet(folder / 'results.parquet')
    assert cli.main(command) == 0
    figure = folder / 'survived_over_speed_friction.png'
    figure.unlink()
    rows.assign(survived=True).to_parquet(folder / 'results.parquet')
    assert cli.main(command) == 1
    assert 'a: 399 of 399 drives fulfil the condition' in capsys.readouterr().err
    assert not figure.exists()
