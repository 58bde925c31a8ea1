"""`experiments scenario`: what a scenario holds, with numbers, and a picture."""

import numpy as np
import pytest
from PIL import Image

from experiments import cli, preview
from experiments.configuration import inputs
from scenario_publisher import advice, scenario


@pytest.fixture(scope='module')
def params():
    return inputs.controller_params('mpcc')


def test_a_car_on_the_path_meets_an_obstacle_where_and_when_it_does(params):
    scn = scenario.load('double_lane_change')
    station = advice.path_demand(scn).station
    met = preview.encounter(scn, scn.actors[0], station, params)
    o, ref = scn.actors[0].obstacle, scn.reference
    nearest = np.hypot(ref.X - o.X, ref.Y - o.Y).min() - o.r_obs - params.body.circle_radius_m
    assert met.gap_m == pytest.approx(nearest, abs=0.03)
    speed = np.diff(station)[0] / np.diff(ref.t)[0]
    assert met.t == pytest.approx(met.station / speed, abs=0.06)


def test_an_obstacle_that_is_gone_is_not_met(params):
    scn = scenario.load('pop_up')
    actor = scn.actors[0]._replace(appears=500.0)
    station = advice.path_demand(scn).station
    assert preview.encounter(scn, actor, station, params) is None


@pytest.mark.parametrize('name', ['several_movers', 'split_mu'])
def test_the_command_prints_and_draws(tmp_path, capsys, name):
    picture = tmp_path / 'scenario.png'
    assert cli.main(['scenario', name, '--plot', str(picture)]) == 0
    text = capsys.readouterr().out
    assert f'scenario:       {name}: ' in text
    assert 'warning' not in text
    for check in scenario.CHECKS:
        assert f'  pass  {check}\n' in text
    assert '  pass  the path asks for no more than the grip of the road\n' in text
    with Image.open(picture) as image:
        assert image.width > 1000
        # the coarse path is drawn in its colour
        pixels = np.asarray(image.convert('RGB')).reshape(-1, 3).astype(int)
    assert np.sum(np.abs(pixels - (0x00, 0x72, 0xB2)).max(axis=1) < 12) > 500


def test_warnings_are_shown(tmp_path, capsys):
    text = scenario.load('straight').text
    short = tmp_path / 'short.yaml'
    short.write_text(text.replace('progress_m: 60.0', 'progress_m: 99.0'))
    assert short.read_text() != text
    assert cli.main(['scenario', str(short)]) == 0
    out = capsys.readouterr().out
    assert '  warn  the path goes on for the horizon behind the finish line\n' in out
    assert 'warning: the path ends' in out


def test_of_a_refused_scenario_is_shown_which_check_failed(tmp_path, capsys):
    text = scenario.load('straight').text
    beyond = tmp_path / 'beyond.yaml'
    beyond.write_text(text.replace('progress_m: 60.0', 'progress_m: 9000.0'))
    assert cli.main(['scenario', str(beyond)]) == 1
    out, error = capsys.readouterr()
    assert '  pass  every obstacle is on the road at some time of the run\n' in out
    assert f'  FAIL  {scenario.FINISH}\n' in out
    assert f'  -     {scenario.PATCHES} (not reached)\n' in out
    assert 'stop.progress_m: is 9000 m, beyond the end of the path' in error
