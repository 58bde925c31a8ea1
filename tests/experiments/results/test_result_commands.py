"""`experiments table` and `plot` as a person calls them."""

import pandas
import pytest

from experiments import cli
from experiments.results import success_surface

SPEED, FRICTION = ('--by', 'speed'), ('--by', 'friction')


def test_a_table_is_shown_and_written(folder, tmp_path, capsys):
    csv, markdown = tmp_path / 'new/table.csv', tmp_path / 'table.md'
    files = ('--csv', str(csv), '--markdown', str(markdown))
    assert cli.main(['table', str(folder), '--by', 'controller', *SPEED, *files]) == 0
    said = capsys.readouterr().out
    assert '1 drives without a result are left out' in said
    assert 'repeats of others' in said
    written = pandas.read_csv(csv)
    assert list(written)[:4] == ['controller', 'speed', 'drives', 'missing']
    assert written['drives'].sum() == 799
    assert markdown.read_text().count('\n') == 2 + len(written)
    assert markdown.read_text().startswith('| controller | speed | drives |')


def test_a_pair_is_shown(folder, capsys):
    command = ['table', str(folder), '--metric', 'clearance_m', '--pair', 'b', 'a']
    assert cli.main(command) == 0
    said = capsys.readouterr().out
    assert 'clearance_m of b minus a' in said
    assert '398' in said


@pytest.mark.parametrize(
    'words',
    [
        SPEED,
        (*SPEED, *FRICTION),
        ('--metric', 'clearance_m', *SPEED),
        ('--metric', 'clearance_m', *SPEED, '--by', 'controller'),
        ('--by', 'controller'),
        (*SPEED, *FRICTION, '--surface'),
    ],
    ids=' '.join,
)
def test_a_figure_is_written_as_png_and_svg(folder, tmp_path, words, monkeypatch):
    monkeypatch.setattr(success_surface, 'RESAMPLES', 10)
    stem = tmp_path / 'figures/one'
    assert cli.main(['plot', str(folder), *words, '--out', str(stem)]) == 0
    assert stem.with_suffix('.png').read_bytes().startswith(b'\x89PNG')
    assert '</svg>' in stem.with_suffix('.svg').read_text()


def test_a_controller_whose_drives_all_agree_has_no_surface(folder, rows, capsys, monkeypatch):
    monkeypatch.setattr(success_surface, 'RESAMPLES', 10)
    command = ['plot', str(folder), *SPEED, *FRICTION, '--surface']
    all_held = rows['survived'].where(rows['controller'] == 'a', True)
    rows.assign(survived=all_held).to_parquet(folder / 'results.parquet')
    assert cli.main(command) == 0
    figure = folder / 'survived_over_speed_friction.png'
    assert figure.is_file()
    figure.unlink()
    rows.assign(survived=True).to_parquet(folder / 'results.parquet')
    assert cli.main(command) == 1
    assert 'a: 399 of 399 drives fulfil the condition' in capsys.readouterr().err
    assert not figure.exists()


@pytest.mark.parametrize(
    ('words', 'what'),
    [
        ((), '--by: is given 0 times; allowed 1 or 2'),
        ((*SPEED, '--surface'), 'allowed exactly 2 with --surface'),
        ((*SPEED, *FRICTION, '--surface', '--metric', 'clearance_m'), 'true or false'),
        ((*SPEED, '--by', 'controller', '--surface'), '--by controller: a surface needs numbers'),
        (('--by', 'sped'), "did you mean 'speed'"),
    ],
)
def test_a_figure_that_cannot_be_drawn_is_one_line(folder, words, what, capsys):
    assert cli.main(['plot', str(folder), *words]) == 1
    assert what in capsys.readouterr().err
