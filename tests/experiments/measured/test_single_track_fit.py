"""What is put into a log comes out of the fit."""

import json

import numpy as np
import pytest
from installation import ROOT
from measured_drives import TRUTH, plant_drive, single_track_log, write_log, write_map

from bags.errors import BagError
from experiments import cli
from experiments.measured import log_map, measured_log, report, single_track_fit, validation
from mpcc_controller import car_file
from vehicle_plant import identify

REFERENCE = [ROOT / 'bags/reference/double_lane_change' / name for name in ('mpcc', 'frenet')]


@pytest.fixture(scope='module')
def car():
    return car_file.read('car.yaml')


def test_what_is_put_in_comes_out_within_its_interval(car):
    inside = []
    for seed in range(3):
        fit = single_track_fit.fit([single_track_log(car, seed)], car)
        assert fit.vague == ()
        inside += [abs(fit.values[n] - TRUTH[n]) <= fit.half_widths[n] for n in TRUTH]
        for name in ('front_friction', 'rear_friction', 'front_cornering_npr'):
            assert fit.half_widths[name] < 0.1 * TRUTH[name]
    assert np.mean(inside) >= 0.8


def test_a_steering_that_gives_way_is_found_where_it_is_and_only_there(car, tmp_path):
    for given in (8e-6, 0.0):
        values = TRUTH | {'front_cornering_npr': 25e4, 'compliance_radpn': given}
        log = single_track_log(car, 5, values=values, noise=(0.01, 0.003))
        fit = single_track_fit.fit([log], car, compliant=True)
        assert fit.values['compliance_radpn'] == pytest.approx(given, abs=1.5e-6)
        report.write_car(tmp_path / 'car.yaml', car, fit, ['made'])
        written = car_file.read(str(tmp_path / 'car.yaml')).tyre.compliance_radpn
        assert written == pytest.approx(fit.values['compliance_radpn'], rel=1e-5)
    report.write_car(tmp_path / 'car.yaml', car, single_track_fit.fit([log], car), ['made'])
    assert car_file.read(str(tmp_path / 'car.yaml')).tyre.compliance_radpn is None


def test_gentle_driving_does_not_tell_the_friction(car):
    log = single_track_log(car, 1, seconds=12.0)
    fit = single_track_fit.fit([log], car)
    assert {'front_friction', 'rear_friction'} <= set(fit.vague)
    fixed = {'front_friction': 0.9, 'rear_friction': 0.9}
    fit = single_track_fit.fit([log], car, fixed=fixed)
    assert fit.values['front_friction'] == 0.9
    assert 'front_friction' not in fit.half_widths


def test_too_little_driving_is_an_error(car):
    with pytest.raises(BagError, match='windows of 2 s above 6 m/s; at least 5'):
        single_track_fit.fit([single_track_log(car, 1, seconds=8.0)], car)


@pytest.fixture(scope='module')
def identified(tmp_path_factory):
    """What `identify --log` makes of a log of the plant, as the command line gives it."""
    folder = tmp_path_factory.mktemp('identified')
    noisy = {
        n: v + np.random.default_rng(3).normal(0, 0.002 * np.ptp(v), len(v)) * (n != 'time')
        for n, v in plant_drive().items()
    }
    log, out = write_log(folder / 'drive.csv', noisy), folder / 'car.yaml'
    words = ['--held-out', log, '--map', write_map(folder / 'map.yaml'), '--out', out]
    assert identify.main(['--log', *map(str, (log, *words))]) == 0
    return folder


def test_the_plant_is_identified_as_by_circular_driving(identified):
    """The front friction within 6 %; the stiffness is that of the transient, where tyres relax."""
    names = ('car.yaml', f'{identified}/car.yaml')
    circle, log = (car_file.read(name).tyre for name in names)
    assert log.front_friction == pytest.approx(circle.front_friction, rel=0.06)
    # an understeering car does not slide at the rear: its log tells how much there is at least
    assert log.rear_friction > 0.95 * circle.rear_friction
    assert log.front_cornering_npr == pytest.approx(circle.front_cornering_npr, rel=0.25)
    assert (identified / 'car.png').stat().st_size > 10_000


def test_its_prediction_is_nearer_than_holding_the_state(identified, capsys, monkeypatch):
    words = 'validate drive.csv --map map.yaml --car ./car.yaml --plant bmw_545i.yaml --out page'
    monkeypatch.chdir(identified)
    monkeypatch.delenv('COLUMNS', raising=False)  # tables would be folded to it
    assert cli.main(words.split()) == 0
    numbers = json.loads((identified / 'page/validation.json').read_text())
    at_limit = {(e['model'], e['ahead_s']): e for e in numbers['errors'] if e['from_mps2'] == 6.0}
    for ahead in (0.5, 1.0, 2.0):
        for name in ('vy', 'r', 'position'):
            ours = at_limit[validation.PREDICTION, ahead][name]
            assert 1.5 * ours < at_limit[validation.HOLD, ahead][name]
            assert ours < at_limit[validation.LINEAR, ahead][name]
    # the plant that made the log repeats it from its measured steer and speed
    plant = numbers['manoeuvres']['drive.csv'][validation.PLANT]
    for name in ('r', 'ay', 'vy'):
        assert plant[f'{name}_rms_of_range'] < 0.05
    assert 'hold the state' in capsys.readouterr().out
    assert (identified / 'page/validation.png').stat().st_size > 10_000


def test_recordings_of_ours_are_logs_too(tmp_path):
    known = log_map.load(write_map(tmp_path / 'map.yaml'))
    logs = [measured_log.load(path, known) for path in REFERENCE]
    fit = single_track_fit.fit(logs, known.car, fixed={'cog_to_front_m': 0.0})
    assert fit.vague == ('front_friction', 'rear_friction')  # they ask for 0.4 of the grip
    assert fit.values['front_cornering_npr'] == pytest.approx(135_530.5, rel=0.1)
    found = validation.validate(logs, report.fitted_car(known.car, fit), fit, None)
    assert all(m.numbers[validation.PREDICTION]['r_rms_of_range'] < 0.05 for m in found.manoeuvres)


@pytest.mark.parametrize(
    ('words', 'error'),
    [
        (['--fix', 'frictoin=0.9'], 'unknown parameter'),
        (['--fix', 'front_friction=9'], 'allowed 0.2 to 2.5'),
        (['--fix', 'front_friction=x'], "must be a number, is 'x'; allowed 0.2 to 2.5"),
    ],
)
def test_a_mistake_on_the_command_line_is_named(tmp_path, capsys, words, error):
    log = write_log(tmp_path / 'drive.csv', plant_drive())
    given = [log, '--map', write_map(tmp_path / 'map.yaml'), '--out', tmp_path / 'car.yaml']
    assert cli.main(['identify', *map(str, given), *words]) == 1
    assert error in capsys.readouterr().err
