"""Errors of the prediction model and of the plant against a log.

Ahead of every measured state: the prediction model (as the controller integrates it, with its tyre
switch and its steps of 50 ms) follows the measured steer, speed and longitudinal acceleration;
beside it stand holding the state and the same car with linear tyres. Through a manoeuvre: all of
them, and the plant with its servos taken out, from the first state on and never corrected.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from experiments.configuration import inputs
from experiments.measured import single_track_fit
from experiments.measured.measured_log import STEP_S, Log, stretches
from experiments.measured.single_track_fit import LONGEST_DELAY_S, Fit, Windows
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, Input, State
from mpcc_controller.parameters import CarParams
from mpcc_controller.problem import stage_parameters
from vehicle_plant.car import split_drive_force
from vehicle_plant.manoeuvres import Case, Run, drive, load_settings
from vehicle_plant.parameters import PlantParams
from vehicle_plant.state import SetPoints

HORIZONS_S = (0.25, 0.5, 1.0, 2.0)
BINS_MPS2 = (0.0, 3.0, 6.0, 20.0)
MODEL_STEP_S, EVERY_S = 0.05, 0.1
CONTROLLER = 'mpcc'  # whose numbers of the model are taken
LINEAR_FRICTION = 1e3  # of a tyre that never slides
ACTIVE_MPS2, AROUND_S, LONGEST_S = 2.0, 0.6, 15.0
FAST_SERVO_RADPS, FAST_RADPS = 300.0, 20.0
SPEED_GAIN_NSPM = 8000.0
MS_PER_STEP = round(1000 * STEP_S)
PREDICTION, LINEAR, HOLD, PLANT = 'prediction model', 'linear tyre', 'hold the state', 'plant'
FITTED = 'with additions'


class HorizonError(NamedTuple):
    """Root mean squares of one model, one horizon, one range of lateral acceleration."""

    model: str
    ahead_s: float
    from_mps2: float
    to_mps2: float
    starts: int
    vy: float  # m/s
    r: float  # rad/s
    position: float  # m


class Manoeuvre(NamedTuple):
    """A stretch of a log, measured and by model: arrays (n,)."""

    log: str
    t: np.ndarray
    measured: dict[str, np.ndarray]  # r, ay, vy, sideslip
    models: dict[str, dict[str, np.ndarray]]
    numbers: dict[str, dict[str, float]]  # by model


class Validation(NamedTuple):
    """What a car file is worth on some logs."""

    errors: list[HorizonError]
    manoeuvres: list[Manoeuvre]


def validate(
    logs: Sequence[Log], car: CarParams, fit: Fit | None, plant: PlantParams | None
) -> Validation:
    """Compare. `fit` has the offsets of the logs, and perhaps additions. Raises BagError."""
    corrections = {} if fit is None else fit.values
    logs = [
        log._replace(vy=log.vy - log.vx * corrections.get('sideslip_offset_rad', 0.0))
        for log in logs
    ]
    extended = corrections | {'cog_to_front_m': 0.0, 'sideslip_offset_rad': 0.0}
    model = stage_parameters.car(inputs.controller_params(CONTROLLER), car)
    linear = model._replace(mu_f=LINEAR_FRICTION, mu_r=LINEAR_FRICTION)

    def simulate(windows):
        """Return vy, r and ay of every model of the controllers' car."""
        delta = _steer(windows, corrections)
        motions = {name: predict(m, windows, delta) for name, m in models.items()}
        if fit is not None and fit.additions:
            start = windows.vy[0], windows.r[0]
            motions[FITTED] = single_track_fit.simulate(car, extended, windows, *start)
        return motions

    models = {PREDICTION: model, LINEAR: linear}
    windows = single_track_fit.cut(logs, HORIZONS_S[-1], EVERY_S)
    held = tuple(np.broadcast_to(x[:1], x.shape) for x in (windows.vy, windows.r, windows.ay))
    errors = _horizon_errors(windows, {HOLD: held, **simulate(windows)})
    manoeuvres = []
    for log in logs:
        window = single_track_fit.window(log, *_stretch(log))
        motions = simulate(window)
        if plant is not None:
            motions[PLANT] = drive_plant(plant, window, _steer(window, corrections))
        manoeuvres.append(_manoeuvre(log.name, window, motions))
    return Validation(errors, manoeuvres)


def _steer(windows, corrections):
    rows, columns = windows.vx.shape
    delay = corrections.get('steer_delay_s', 0.0)
    steer = single_track_fit.delayed(windows.steer, delay, rows, columns)
    return steer + corrections.get('steer_offset_rad', 0.0)


def predict(model: Car, windows: Windows, delta: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return vy, r, ay (rows, columns) of the prediction model from the first row of each window.

    Its speed and its force are the measured ones at every step of the model.
    """
    rows, columns = windows.vx.shape
    dt = MODEL_STEP_S
    step = single_track.step(dt, single_track.structure(model)).map(columns)
    cars = np.tile(np.array(model, float)[:, None], columns)
    t, at = np.arange(rows) * STEP_S, np.arange(0, (rows - 1) * STEP_S + dt / 2, dt)
    vx, ax, steer = (_sampled(at, t, values) for values in (windows.vx, windows.ax, delta))
    vy, r, zero = windows.vy[0], windows.r[0], np.zeros(columns)
    out = np.empty((3, len(at), columns))
    for k in range(len(at)):
        following = min(k + 1, len(at) - 1)
        force = model.m * ax[k] + model.drag * vx[k] ** 2 + model.rolling
        u = Input((steer[following] - steer[k]) / dt, zero, np.full(columns, 0.6), zero)
        x = State(zero, zero, zero, vx[k], vy, r, zero, steer[k], force)
        following_x = State(*step(np.array(x), np.array(u), cars).full())
        ay = (following_x.vy - vy) / dt + (vx[k] + vx[following]) / 2 * (r + following_x.r) / 2
        out[:, k] = vy, r, ay
        vy, r = following_x.vy, following_x.r
    return tuple(_sampled(t, at, values) for values in out)


def _sampled(t, known, values):
    return np.column_stack([np.interp(t, known, column) for column in values.T])


def _positions(vx, vy, r):
    """Return x, y (rows, columns) in the frame of the first row."""

    def integral(values):
        sums = np.cumsum((values[1:] + values[:-1]) / 2 * STEP_S, axis=0)
        return np.concatenate([np.zeros((1, values.shape[1])), sums])

    psi = integral(np.asarray(r))
    cos, sin = np.cos(psi), np.sin(psi)
    return integral(vx * cos - vy * sin), integral(vx * sin + vy * cos)


def _horizon_errors(windows, motions):
    x, y = _positions(windows.vx, windows.vy, windows.r)
    result = []
    for model, (vy, r, _) in motions.items():
        vx = np.broadcast_to(windows.vx[:1], vy.shape) if model == HOLD else windows.vx
        x_model, y_model = _positions(vx, vy, r)
        away = np.hypot(x_model - x, y_model - y)
        for ahead in HORIZONS_S:
            k = round(ahead / STEP_S)
            hardest = np.abs(windows.ay[: k + 1]).max(axis=0)
            for low, high in pairwise(BINS_MPS2):
                rows = (hardest >= low) & (hardest < high)
                if rows.any():
                    parts = (vy - windows.vy)[k, rows], (r - windows.r)[k, rows], away[k, rows]
                    rms = (float(np.sqrt(np.mean(part**2))) for part in parts)
                    result.append(HorizonError(model, ahead, low, high, int(rows.sum()), *rms))
    return result


def _stretch(log):
    """Return the rows of the manoeuvre with the greatest lateral acceleration."""
    from scipy.ndimage import maximum_filter1d

    usable = log.valid & (log.vx > single_track_fit.LEAST_SPEED_MPS)
    margin, around = round(LONGEST_DELAY_S / STEP_S), 2 * round(AROUND_S / STEP_S) + 1
    active = maximum_filter1d(np.abs(log.ay) * usable > ACTIVE_MPS2, around)
    parts = [(max(a, margin), b) for a, b in stretches(active & usable) if b - a > 2 * margin]
    a, b = max(parts or [(margin, len(log.t))], key=lambda part: np.abs(log.ay[slice(*part)]).max())
    longest = round(LONGEST_S / STEP_S)
    if b - a > longest:  # around the peak
        peak = a + int(np.argmax(np.abs(log.ay[a:b])))
        a = int(np.clip(peak - longest // 2, a, b - longest))
        b = a + longest
    return a, b


def _manoeuvre(name, window, motions):
    measured = _signals(window.vx, window.vy, window.r, window.ay)
    models = {model: _signals(window.vx, *parts) for model, parts in motions.items()}
    t = np.arange(len(window.vx)) * STEP_S
    numbers = {model: _numbers(t, measured, signals) for model, signals in models.items()}
    return Manoeuvre(name, t, measured, models, numbers)


def _signals(vx, vy, r, ay):
    columns = {'r': r, 'ay': ay, 'vy': vy, 'sideslip': np.arctan2(vy, vx)}
    return {name: column[:, 0] for name, column in columns.items()}


def _numbers(t, measured, signals):
    """Return rms over range, and both peaks: error over range and instant [s]."""
    numbers: dict[str, Any] = {}
    for name, reference in measured.items():
        span, values = np.ptp(reference), signals[name]
        numbers[f'{name}_rms_of_range'] = np.sqrt(np.mean((values - reference) ** 2)) / span
        for word, at in (('greatest', np.argmax), ('least', np.argmin)):
            i, k = at(reference), at(values)
            numbers[f'{name}_{word}'] = reference[i]
            numbers[f'{name}_{word}_error'] = values[k] - reference[i]
            numbers[f'{name}_{word}_late_s'] = t[k] - t[i]
    return {name: float(value) for name, value in numbers.items()}


def drive_plant(
    plant: PlantParams, window: Windows, delta: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vy, r, ay (rows, 1) of the plant, from straight rolling, at steer and speed.

    Its servos are taken out: tyres and chassis are compared, not actuators.
    """
    fast = replace(
        plant.car.steering,
        natural_frequency_radps=FAST_SERVO_RADPS,
        damping=1.0,
        rate_radps=FAST_RADPS,
        limit_rad=1.0,
        delay_ms=0,
    )
    gate = replace(plant.car.gate, steer_rate_radps=np.inf, steer_tolerance_rad=np.inf)
    plant = replace(plant, car=replace(plant.car, steering=fast, gate=gate))
    t, lag = np.arange(len(delta)) * STEP_S, 2 / FAST_SERVO_RADPS
    case = Case(plant, 1.0, load_settings())
    body, brakes = plant.car.body, plant.car.force
    front = brakes.front.brake_n / (brakes.front.brake_n + brakes.rear.brake_n)

    def law(due, vx):
        steer, ax = np.interp(due + lag, t, delta[:, 0]), np.interp(due, t, window.ax[:, 0])
        force = body.mass_kg * ax + SPEED_GAIN_NSPM * (np.interp(due, t, window.vx[:, 0]) - vx)
        force += body.air_density_kgpm3 / 2 * body.drag_area_m2 * vx**2
        if force > 0:
            return SetPoints(float(steer), *split_drive_force(plant.car, float(force)))
        return SetPoints(float(steer), float(force * front), float(force * (1 - front)))

    run = Run('log', float(window.vx[0, 0]), t[-1] + 2 * MODEL_STEP_S, law)
    track = drive(run, case)
    rows = np.arange(len(delta)) * MS_PER_STEP
    columns = ('planar.vy', 'planar.r', 'acceleration.ay')
    # the first row is at 1 ms
    vy, r, ay = (track.column(name)[np.maximum(rows - 1, 0)][:, None] for name in columns)
    return vy, r, ay
