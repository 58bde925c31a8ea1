"""Sideslip angle of real cars from their IMU, steering and speed, against the measured one.

    python bench/real_sideslip.py volvo_v40 SWD_80kph.VBO --fit runs/car_volvo_v40.yaml

The maps of the logs are bench/real_cars/*.yaml, which say where the files are from. The estimator
gets the accelerations, moved from the IMU to the CoG, the yaw rate without the lateness
that its map states, the road-wheel angle, and the longitudinal speed in place of that of the rear
wheels; no position. Tyres and offsets are those that `experiments identify` or bench/real_cars.py
found in other logs of the car; roll, and friction where no log tells it, are judgement. Compared
are the filter, the kinematic observer, and zero.
"""

import argparse
import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.estimation import front_stiffness
from experiments.measured import log_map, measured_log, report
from experiments.measured.single_track_fit import Fit
from msgs_yaml.types import Chassis, Gnss, Inertial
from node_runtime import node_parameters, parameters
from state_estimator import estimators
from state_estimator.parameters import EstimatorParams, Vehicle

MAPS = Path(__file__).parent / 'real_cars'
LIMIT_MPS2 = 6.0
LEAST_MPS = 5.0
MOST_STEER_RAD = 1.0  # what is beyond is a spike
RADIUS_M, TRACK_M = 0.3, 1.5  # any: speed is given as that of wheels
# of these logs and their roads, chosen on the logs that were fitted: speed is exact; without a roll
# rate, roll follows at once; a road's bank and slope change within seconds; tyres err by more
OWN = {
    'acceleration_walk': 0.1,
    'roll_noise': 0.01,
    'roll_time_s': 0.05,
    'pitch_noise': 0.2,
    'tyre_noise_mps2': 0.4,
    'tyre_error': 0.2,
    'tyre_time_s': 0.25,
    'wheel_noise_mps': 0.02,
    'wheel_error': 0.0,
    'wheel_time_s': 0.05,
}
# rad per m/s^2, of the body; judgement, as no log tells it
ROLL = {'volvo_v40': 0.0075, 'volvo_s90': 0.006, 'ferrari_250lm': 0.003}
UNTOLD_FRICTION = 1.0  # where the logs that were fitted do not tell it


def vehicle(known: log_map.LogMap, fit: Fit, roll_radps2: float) -> Vehicle:
    """Return the car of a map with the tyres of a fit."""
    fitted = report.fitted_car(known.car, fit)
    own, tyre = fitted.car, fitted.tyre
    friction = {
        name: UNTOLD_FRICTION if name in fit.vague else getattr(tyre, name)
        for name in ('front_friction', 'rear_friction')
    }
    return Vehicle(
        mass_kg=own.mass_kg,
        yaw_inertia_kgm2=own.yaw_inertia_kgm2,
        front_m=own.cog_to_front_m,
        rear_m=own.cog_to_rear_m,
        cog_height_m=own.cog_height_m,
        track_m=TRACK_M,
        wheel_radius_m=RADIUS_M,
        drive_front_share=1.0,
        front_cornering_npr=front_stiffness(tyre),
        rear_cornering_npr=tyre.rear_cornering_npr,
        **friction,
        relaxation_m=0.5,
        slip_per_mps2=0.0,
        roll_radps2=roll_radps2,
        pitch_radps2=0.5 * roll_radps2,
    )


def messages(signals: dict[str, np.ndarray], known: log_map.LogMap, fit: Fit):
    """Yield what the sensors say, in order; a first fix says the speed."""
    t, sensor = signals['time'], known.columns.sensor
    ahead, left = sensor.ahead_m or 0.0, sensor.left_m or 0.0
    r = np.interp(t + (known.columns.signals.yaw_rate.late_s or 0.0), t, signals['yaw_rate'])
    turning = np.append(0.0, np.diff(r) / np.diff(t))
    ax = signals['ax'] + ahead * r**2 + left * turning
    ay = signals['ay'] - ahead * turning + left * r**2
    vx = signals['vx'] + left * r
    steer = signals['steer']
    spikes = ~(np.abs(steer) < MOST_STEER_RAD)
    last = np.maximum.accumulate(np.where(spikes, 0, np.arange(len(t))))
    steer = np.interp(t - fit.values['steer_delay_s'], t, steer[last])
    steer = steer + fit.values['steer_offset_rad']
    for k in range(len(t)):
        ns = round(t[k] * 1e9) + 1_000_000_000
        if k == 0:
            yield Gnss(ns, 0.0, 0.0, float(vx[0]), 0.0)
        wheels = (math.nan, math.nan, vx[k] - TRACK_M / 2 * r[k], vx[k] + TRACK_M / 2 * r[k])
        yield Chassis(ns, float(steer[k]), tuple(w / RADIUS_M for w in wheels))
        yield Inertial(ns, float(ax[k]), float(ay[k]), float(r[k]))


def compare(car: str, path: Path, fit: Fit, begin: float = 0.0, end: float = 1.0) -> dict:
    """Return rms and greatest errors [deg] by method, between two shares of the time."""
    known = log_map.load(MAPS / f'{car}.yaml')
    signals = measured_log.read(path, known)
    t = signals['time'] - signals['time'][0]
    part = (t >= begin * t[-1]) & (t <= end * t[-1]) & np.append(True, np.diff(t) > 0)
    moving = np.cumsum(part & (signals['vx'] > LEAST_MPS)) > 0  # begins on the move
    signals = {name: x[part & moving] for name, x in signals.items()} | {'time': t[part & moving]}
    truth = measured_log.load(path, known)
    step = float(np.median(np.diff(signals['time'])))
    defaults = node_parameters.find_config('state_estimator', 'estimator.yaml')
    params = parameters.load(EstimatorParams, defaults)
    params = replace(params, imu_s=step, chassis_s=step, **OWN)
    beta = np.arctan2(truth.vy, truth.vx) - fit.values['sideslip_offset_rad']
    rows, own = {}, vehicle(known, fit, ROLL[car])
    for method in ('filter', 'kinematic'):
        estimator = estimators.create(replace(params, method=method, car=own, yaw_rad=0.0))
        results = [e for m in messages(signals, known, fit) if (e := estimator.update(m))]
        at = np.array([(e.state.stamp_ns - 1_000_000_000) / 1e9 for e in results])
        believed = np.array([math.atan2(e.state.vy, e.state.vx) for e in results])
        rows[method] = np.interp(truth.t, at, believed, left=np.nan, right=np.nan)
        if method == 'filter':
            sd = [math.sqrt(e.covariance[4, 4]) / max(e.state.vx, 1.0) for e in results]
            sd = np.interp(truth.t, at, sd)
    fast = truth.valid & (truth.vx > LEAST_MPS) & np.isfinite(rows['filter'])
    chosen = fast & (np.abs(truth.ay) > LIMIT_MPS2)
    errors = {name: np.degrees(row - beta) for name, row in rows.items()} | {
        'zero': np.degrees(-beta)
    }
    table = {}
    for name, error in errors.items():
        table[name] = {
            'rms_deg': float(np.sqrt(np.mean(error[chosen] ** 2))),
            'greatest_deg': float(np.abs(error[chosen]).max()),
            'rms_all_deg': float(np.sqrt(np.mean(error[fast] ** 2))),
        }
    inside = np.abs(errors['filter']) <= 2 * np.degrees(sd)
    table['filter']['within_2_sigma'] = float(inside[fast].mean())
    table['seconds'] = float(chosen.sum() * measured_log.STEP_S)
    return table


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('car', choices=ROLL)
    parser.add_argument('log', type=Path)
    text = 'car file of `experiments identify` on other logs, its .json beside it'
    parser.add_argument('--fit', type=Path, required=True, metavar='FILE', help=text)
    parser.add_argument('--part', type=float, nargs=2, default=(0.0, 1.0), metavar=('FROM', 'TO'))
    options = parser.parse_args()
    fit = report.read_fit(options.fit)
    if fit is None:
        parser.error(f'--fit {options.fit}: has no .json of `experiments identify` beside it')
    table = compare(options.car, options.log, fit, *options.part)
    print(f'{options.log.name}: {table.pop("seconds"):.1f} s above {LIMIT_MPS2:g} m/s^2')
    for name, row in table.items():
        print(f'  {name:10}', ', '.join(f'{key} {value:.2f}' for key, value in row.items()))


if __name__ == '__main__':
    main()
