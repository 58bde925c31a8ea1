"""`experiments paper` drives both experiments of the paper and draws them."""

import json
from pathlib import Path

import pytest

from experiments import cli

ROOT = Path(__file__).parents[2]


@pytest.mark.nightly  # the pages of the documentation run its parts
@pytest.mark.usefixtures('dds')
def test_both_experiments_are_driven_and_the_picture_of_the_paper_is_drawn(tmp_path, monkeypatch):
    (tmp_path / 'paper').mkdir()
    for part in ('circle_20m', 'picture'):
        (tmp_path / 'paper' / part).symlink_to(ROOT / 'paper' / part)
    monkeypatch.chdir(tmp_path)
    assert cli.main(['paper', '--out', 'drawn']) == 0
    distances = json.loads(Path('drawn/circle_20m/distances.json').read_text())
    recorded = distances['recorded']
    assert recorded['collided']  # nothing keeps it away
    # measured at the driven poses, and by closed form for them
    assert recorded['largest_deviation_from_closed_form_m'] < 1e-9
    # the car kept close to the path, so the table for the path holds for the drive as well
    for side in ('inside', 'outside'):
        closed = distances['overestimation_m'][side]
        assert recorded['overestimation_m'][side] == pytest.approx(closed, abs=0.05)
    runs = json.loads(Path('drawn/double_lane_change/comparison.json').read_text())['runs']
    mpcc, baseline = (runs[f'{name}_limit'] for name in ('mpcc', 'frenet'))
    assert not mpcc['entered_unsafe_area']
    assert baseline['entered_unsafe_area']
    assert mpcc['peak_sideslip_deg'] < 4.0
    assert baseline['peak_sideslip_deg'] > 6.0
    assert Path('drawn/double_lane_change/figures/comparison.png').is_file()
    assert Path('drawn/circle_20m/distances.png').stat().st_size > 10_000


def test_outside_of_a_clone_it_says_so(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(['paper']) == 1
    assert 'runs in a clone' in capsys.readouterr().err
