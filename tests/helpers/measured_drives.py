"""Logs with known truth: of the plant in four formats, and of the single track itself."""

from functools import cache

import numpy as np
import pandas
from scipy.io import savemat

from experiments.measured import single_track_fit
from experiments.measured.measured_log import STEP_S, Log
from experiments.measured.single_track_fit import LONGEST_DELAY_S, Windows
from vehicle_plant import manoeuvres, parameters
from vehicle_plant.manoeuvres import Case, Run, hold_speed
from vehicle_plant.state import SetPoints

MAP = """\
{like}steering_ratio: 16
signals:
  time: {{column: time, unit: {time}}}
  steer: {{column: SteerAng, unit: deg}}
  vx: {{column: speed, unit: km/h}}
  vy: {{column: lateral, unit: km/h}}
  yaw_rate: {{column: YawRate, unit: deg/s, sign: -1}}
  ay: {{column: Y_Accel, unit: g}}
car: {{mass_kg: 1850, yaw_inertia_kgm2: 3300, cog_to_front_m: 1.43, cog_to_rear_m: 1.46,
      cog_height_m: 0.54}}
"""
TRUTH = {
    'front_cornering_npr': 9e4,
    'rear_cornering_npr': 15e4,
    'front_friction': 0.92,
    'rear_friction': 0.97,
    'cog_to_front_m': 0.02,
    'steer_offset_rad': 0.002,
    'steer_delay_s': 0.05,
    'sideslip_offset_rad': 0.004,
}


def steer_at(t, greatest):
    """Return a slalom whose amplitude grows, from straight driving on."""
    t = np.maximum(np.asarray(t) - 1.0, 0.0)
    return greatest * np.minimum(t / 20, 1.0) * np.sin(2 * np.pi * 0.45 * t)


@cache
def plant_drive(seconds=24.0):
    """Return the signals of the plant at 100 Hz, in the units of MAP."""
    case = Case(
        parameters.load(parameters.car_file(parameters.DEFAULT_CAR, '')),
        1.0,
        manoeuvres.load_settings(),
    )
    hold = hold_speed(case, 20.0)
    run = Run('', 20.0, seconds, lambda t, vx: SetPoints(float(steer_at(t, 0.10)), *hold(vx)))
    column = manoeuvres.drive(run, case).column
    return {
        'time': np.arange(0, seconds, 0.01),
        'SteerAng': np.degrees(16 * column('servos.steer.position'))[::10],
        'speed': 3.6 * column('planar.vx')[::10],
        'lateral': 3.6 * column('planar.vy')[::10],
        'YawRate': -np.degrees(column('planar.r'))[::10],
        'Y_Accel': column('acceleration.ay')[::10] / 9.80665,
    }


def write_map(path, time='s', like='', text=MAP):
    """Write the map of such a log."""
    path.write_text(text.format(time=time, like=like))
    return path


def write_log(path, columns):
    """Write columns in the format of the name."""
    if path.suffix == '.csv':
        pandas.DataFrame(columns).to_csv(path, index=False)
    elif path.suffix == '.mat':
        savemat(path, columns)
    else:
        t = columns['time'] + 10 * 3600 + 59 * 60 + 50.0
        clock = t // 3600 * 1e4 + t % 3600 // 60 * 100 + t % 60
        rows = np.column_stack([clock, *(v for name, v in columns.items() if name != 'time')])
        names = ' '.join(['time', *(name for name in columns if name != 'time')])
        lines = '\n'.join(' '.join(f'{value:.6f}' for value in row) for row in rows)
        path.write_text(f'[header]\ntime\n\n[column names]\n{names}\n\n[data]\n{lines}\n12 3')
    return path


def single_track_log(car, seed, seconds=30.0, values=None, noise=(0.03, 0.01)):
    """Return a log that the single track of the fit made, with noise of vy [m/s] and r [rad/s]."""
    values = TRUTH if values is None else values
    rng, t = np.random.default_rng(seed), np.arange(0, seconds, STEP_S)
    early = np.arange(-LONGEST_DELAY_S, seconds - STEP_S / 2, STEP_S)
    zero, vx = np.zeros((len(t), 1)), np.full((len(t), 1), 20.0)
    window = Windows(steer_at(early, 0.12)[:, None], vx, zero, zero, zero, zero)
    motion = single_track_fit.simulate(car, values, window.corrected(values)._replace(vy=zero))
    vy = motion.vy[:, 0] + 20.0 * values['sideslip_offset_rad'] + rng.normal(0, noise[0], len(t))
    r = motion.r[:, 0] + rng.normal(0, noise[1], len(t))
    steer = steer_at(t, 0.12)
    return Log('made', t, steer, vx[:, 0], vy, r, zero[:, 0], motion.ay[:, 0], t >= 0, ())
