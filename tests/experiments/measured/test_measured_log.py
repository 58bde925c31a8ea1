"""A log of the plant is read alike from every format, and no mistake in it passes in silence."""

import numpy as np
import pytest
from measured_drives import MAP, plant_drive, write_log, write_map

from bags.errors import BagError
from experiments.measured import log_map, measured_log
from experiments.measured.measured_log import STEP_S


def load(tmp_path, columns, suffix='.csv', **of_map):
    time = 'hhmmss' if suffix == '.vbo' else 's'
    known = log_map.load(write_map(tmp_path / 'car.map.yaml', time, **of_map))
    return measured_log.load(write_log(tmp_path / f'drive{suffix}', columns), known)


def test_each_format_gives_the_motion_of_the_plant(tmp_path):
    columns = plant_drive()
    for suffix in ('.csv', '.mat', '.vbo'):  # that of the VBO begins before a full hour
        log = load(tmp_path, columns, suffix)
        at = np.interp(log.t, columns['time'], -np.radians(columns['YawRate']))
        assert log.r == pytest.approx(at, abs=0.01)
        assert log.steer == pytest.approx(
            np.interp(log.t, columns['time'], np.radians(columns['SteerAng'])) / 16, abs=2e-3
        )
        assert log.vy == pytest.approx(
            np.interp(log.t, columns['time'], columns['lateral']) / 3.6, abs=0.02
        )
        # dvy/dt + vx r is what the accelerometer of the plant measures
        measured = np.interp(log.t, columns['time'], columns['Y_Accel']) * 9.80665
        assert np.sqrt(np.mean((log.ay - measured) ** 2)) < 0.1
        assert log.valid.all()
        assert log.notes == ()


def test_a_sensor_beside_the_cog_with_a_late_yaw_rate_measures_the_same_car(tmp_path):
    columns = dict(plant_drive())
    r = -np.radians(columns['YawRate'])
    columns['speed'] = columns['speed'] - 3.6 * 0.8 * r
    columns['lateral'] = columns['lateral'] - 3.6 * 0.7 * r
    columns['YawRate'] = np.interp(columns['time'] - 0.05, columns['time'], columns['YawRate'])
    late = MAP.replace('column: YawRate,', 'column: YawRate, late_s: 0.05,')
    text = 'sensor: {{ahead_m: -0.7, left_m: 0.8}}\n' + late
    moved, plain = load(tmp_path, columns, text=text), load(tmp_path, plant_drive())
    rows = slice(0, -round(0.5 / STEP_S))  # at its end the log lacks what is late
    for name in ('vx', 'vy', 'r'):
        same = pytest.approx(getattr(plain, name)[rows], abs=1e-3)
        assert getattr(moved, name)[rows] == same


@pytest.mark.parametrize(
    ('name', 'factor', 'error'),
    [
        ('YawRate', -1, 'yaw_rate over vx steer / L is -'),
        ('Y_Accel', -1, 'ay over vx yaw_rate is -'),
        ('lateral', -1, 'vy: with the other sign'),
        ('speed', -1, 'vx: is negative'),
        ('speed', 3.6, 'are the units of vx and yaw_rate right'),
        ('speed', 1 / 3.6, 'speed in km/h'),
        ('SteerAng', np.pi / 180, 'yaw_rate over vx steer / L is '),
        ('SteerAng', 1 / 16, 'the steering ratio left out or doubly applied'),
        ('Y_Accel', 9.81, 'as with g read as m/s'),
    ],
)
def test_a_wrong_sign_or_unit_is_named(tmp_path, name, factor, error):
    columns = plant_drive() | {name: factor * plant_drive()[name]}
    with pytest.raises(BagError, match=error):
        load(tmp_path, columns)


def test_spikes_and_gaps_are_left_out_and_told(tmp_path):
    columns = {name: values.copy() for name, values in plant_drive().items()}
    columns['SteerAng'][[300, 700, 701, 702, 703]] = 27899.0
    columns['YawRate'][1200] = -400.0
    columns['lateral'][900] = np.nan
    columns['lateral'][2000:2080] = columns['lateral'][2000]
    kept = np.ones(len(columns['time']), bool)
    kept[1500:1580] = False
    log = load(tmp_path, {name: values[kept] for name, values in columns.items()})
    clean = load(tmp_path, plant_drive())
    rows = slice(0, round(14.5 / STEP_S))
    for name, most in (('steer', 3e-3), ('r', 0.02), ('vy', 0.05)):
        assert getattr(log, name)[rows] == pytest.approx(getattr(clean, name)[rows], abs=most)
    assert log.valid[rows].all()
    assert not log.valid[round(14.95 / STEP_S) : round(15.85 / STEP_S)].any()
    assert 'steer: 5 rows of spikes' in log.notes
    assert '1 gaps, together 0.8 s' in log.notes
    assert any(note.startswith('vy: stands still for') for note in log.notes)


def test_rows_that_repeat_are_used_once(tmp_path):
    columns = {name: np.repeat(values, 5) for name, values in plant_drive().items()}
    del columns['time']
    lines = [line for line in MAP.splitlines() if 'column: time' not in line]
    log = load(tmp_path, columns, '.mat', text='\n'.join(['rate_hz: 100', *lines, '']))
    assert log.r == pytest.approx(load(tmp_path, plant_drive()).r, abs=0.02)
    assert log.notes == ('9600 rows repeat the one before: left out',)


@pytest.mark.parametrize(
    ('change', 'error'),
    [
        (lambda c: c | {'time': c['time'][::-1]}, 'time: does not increase'),
        (lambda c: c | {'time': c['time'] * 10}, 'time: 10 rows a second; at least 20'),
        (lambda c: {n: c[n] for n in c if n != 'lateral'}, "vy: there is no column 'lateral'"),
        (lambda c: {n: v[:50] for n, v in c.items()}, 'has 50 rows; at least 100'),
        (lambda c: c | {'SteerAng': 0 * c['time']}, 'steer: does not change'),
        (
            lambda c: c | {'lateral': np.where(c['time'] > 15, np.nan, c['lateral'])},
            '% of the rows are wrong',
        ),
    ],
)
def test_a_log_that_tells_nothing_is_an_error(tmp_path, change, error):
    with pytest.raises(BagError, match=error):
        load(tmp_path, change(dict(plant_drive())))


@pytest.mark.parametrize(
    ('old', 'new', 'error'),
    [
        ('unit: deg}}', 'unit: degrees}}', 'signals.steer.unit: is'),
        ('mass_kg: 1850, ', '', 'car.mass_kg: is missing; allowed 100 to'),
        ('steering_ratio: 16', 'steering_ratio: 900', 'steering_ratio: is 900'),
        ('YawRate, unit: deg/s, ', 'YawRate, ', 'yaw_rate.unit: has no value; allowed rad/s or'),
        ('{like}', 'like: nobody.yaml\n', 'has no file config/nobody.yaml'),
    ],
)
def test_a_mistake_in_the_map_is_named(tmp_path, old, new, error):
    with pytest.raises((BagError, OSError), match=error):
        log_map.load(write_map(tmp_path / 'm.yaml', text=MAP.replace(old, new)))
