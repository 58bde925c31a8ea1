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


WARNED = ('warn  the path goes on for the horizon behind the finish line', 'warning: the path ends')
REFUSED = (
    'pass  every obstacle is on the road at some time of the run\n',
    f'FAIL  {scenario.FINISH}\n',
    f'-     {scenario.PATCHES} (not reached)\n',
    'stop.progress_m: is 9000 m, beyond the end of the path',
)


@pytest.mark.parametrize(('finish_m', 'code', 'said'), [(99.0, 0, WARNED), (9000.0, 1, REFUSED)])
def test_which_check_warned_or_failed_is_shown(tmp_path, capsys, finish_m, code, said):
    file = tmp_path / 'own.yaml'
    text = scenario.load('straight').text
    file.write_text(text.replace('progress_m: 60.0', f'progress_m: {finish_m}'))
    assert cli.main(['scenario', str(file)]) == code
    shown = ''.join(capsys.readouterr())
    assert [part for part in said if part not in shown] == []
