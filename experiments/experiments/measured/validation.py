"""Errors of the prediction model and of the plant against a log.

Ahead of every measured state: the prediction model (as the controller integrates it, with its tyre
switch and its steps of 50 ms) follows the measured steer, speed and longitudinal acceleration;
beside it stand holding the state and the same car with linear tyres. Through a manoeuvre: all of
them, and the plant with its servos taken out, from the first state on and never corrected.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import maximum_filter1d

from experiments.configuration import inputs
from experiments.measured import single_track_fit
from experiments.measured.measured_log import STEP_S, Log
from experiments.measured.single_track_fit import (
    CONTROLLER,
    LONGEST_DELAY_S,
    MODEL_STEP_S,
    SIGNALS,
    Fit,
    Windows,
    predict,
)
from mpcc_controller.parameters import CarParams
from mpcc_controller.problem import stage_parameters
from vehicle_plant.car import split_drive_force
from vehicle_plant.manoeuvres import Case, Run, drive, load_settings
from vehicle_plant.parameters import PlantParams
from vehicle_plant.state import SetPoints

HORIZONS_S = (0.25, 0.5, 1.0, 2.0)
BINS_MPS2 = (0.0, 3.0, 6.0, 20.0)
EVERY_S = 0.1
LINEAR_FRICTION = 1e3  # of a tyre that never slides
ACTIVE_MPS2, AROUND_S, LONGEST_S = 2.0, 0.6, 15.0
FAST_SERVO_RADPS, FAST_RADPS = 300.0, 20.0
SPEED_GAIN_NSPM = 8000.0
MS_PER_STEP = round(1000 * STEP_S)
PREDICTION, LINEAR, HOLD, PLANT = 'prediction model', 'linear tyre', 'hold the state', 'plant'
COLUMNS = ('model', 'ahead_s', 'from_mps2', 'to_mps2', 'starts', 'vy', 'r', 'position')


class Manoeuvre(NamedTuple):
    """A stretch of a log as one window, measured and by model."""

    log: str
    measured: Windows
    models: dict[str, Windows]
    numbers: dict[str, dict[str, float]]  # by model


class Validation(NamedTuple):
    """What a car file is worth on some logs.

    `errors` has a row for each model, horizon and range of lateral acceleration, as `COLUMNS`: root
    mean squares of vy [m/s], r [rad/s] and position [m], and over how many starts.
    """

    errors: pandas.DataFrame
    manoeuvres: list[Manoeuvre]


def validate(
    logs: Sequence[Log], car: CarParams, fit: Fit | None, plant: PlantParams | None
) -> Validation:
    """Compare. `fit` has the offsets of the logs. Raises BagError."""
    values = {} if fit is None else fit.values
    model = stage_parameters.car(inputs.controller_params(CONTROLLER), car)
    linear = model._replace(mu_f=LINEAR_FRICTION, mu_r=LINEAR_FRICTION)

    def simulate(windows):
        """Return the motion of every model of the controllers' car."""
        return {PREDICTION: predict(model, windows), LINEAR: predict(linear, windows)}

    windows = single_track_fit.cut(logs, HORIZONS_S[-1], EVERY_S).corrected(values)
    held = Windows(windows.steer, *(np.broadcast_to(x[:1], x.shape) for x in windows[1:]))
    errors = _horizon_errors(windows, {HOLD: held, **simulate(windows)})
    manoeuvres = []
    for log in logs:
        window = single_track_fit.window(log, *_stretch(log)).corrected(values)
        motions = simulate(window)
        if plant is not None:
            motions[PLANT] = drive_plant(plant, window)
        numbers = {name: _numbers(window, motion) for name, motion in motions.items()}
        manoeuvres.append(Manoeuvre(log.name, window, motions, numbers))
    return Validation(errors, manoeuvres)


def _positions(windows):
    """Return x, y (2, rows, columns) in the frame of the first row."""
    integral = partial(cumulative_trapezoid, dx=STEP_S, axis=0, initial=0.0)
    psi, vx, vy = integral(windows.r), windows.vx, windows.vy
    cos, sin = np.cos(psi), np.sin(psi)
    return np.array([integral(vx * cos - vy * sin), integral(vx * sin + vy * cos)])


def _horizon_errors(windows, motions):
    result = []
    for model, motion in motions.items():
        away = np.hypot(*_positions(motion) - _positions(windows))
        errors = motion.vy - windows.vy, motion.r - windows.r, away
        for ahead in HORIZONS_S:
            k = round(ahead / STEP_S)
            hardest = np.abs(windows.ay[: k + 1]).max(axis=0)
            for low, high in pairwise(BINS_MPS2):
                rows = (hardest >= low) & (hardest < high)
                if rows.any():
                    rms = (float(np.sqrt(np.mean(e[k, rows] ** 2))) for e in errors)
                    result.append((model, ahead, low, high, int(rows.sum()), *rms))
    return pandas.DataFrame(result, columns=COLUMNS)


def _stretch(log):
    """Return the rows of the manoeuvre with the greatest lateral acceleration."""
    usable, hardness = single_track_fit.usable(log), np.abs(log.ay)
    margin, around = round(LONGEST_DELAY_S / STEP_S), 2 * round(AROUND_S / STEP_S) + 1
    active = maximum_filter1d(hardness * usable > ACTIVE_MPS2, around)
    parts = [
        (max(a, margin), b)
        for a, b in single_track_fit.stretches(active & usable)
        if b - a > 2 * margin
    ]
    a, b = max(parts or [(margin, len(log.t))], key=lambda part: hardness[slice(*part)].max())
    longest = min(round(LONGEST_S / STEP_S), b - a)  # around the peak
    peak = a + int(np.argmax(hardness[a:b]))
    a = int(np.clip(peak - longest // 2, a, b - longest))
    return a, a + longest


def _numbers(measured, motion):
    """Return rms over range, and both peaks: value, error and delay [s], of each signal."""
    numbers = {}
    for name in SIGNALS:
        reference, values = (getattr(windows, name)[:, 0] for windows in (measured, motion))
        rms = np.sqrt(np.mean((values - reference) ** 2))
        numbers[f'{name}_rms_of_range'] = float(rms / np.ptp(reference))
        for word, at in (('greatest', np.argmax), ('least', np.argmin)):
            i, k = int(at(reference)), int(at(values))
            numbers[f'{name}_{word}'] = float(reference[i])
            numbers[f'{name}_{word}_error'] = float(values[k] - reference[i])
            numbers[f'{name}_{word}_late_s'] = k * STEP_S - i * STEP_S
    return numbers


def drive_plant(plant: PlantParams, window: Windows) -> Windows:
    """Return the motion of the plant, from straight rolling, at the steer and speed of a window.

    Its servos are taken out: tyres and chassis are compared, not actuators.
    """
    at_once = {'natural_frequency_radps': FAST_SERVO_RADPS, 'damping': 1.0, 'delay_ms': 0}
    fast = replace(plant.car.steering, rate_radps=FAST_RADPS, limit_rad=1.0, **at_once)
    gate = replace(plant.car.gate, steer_rate_radps=np.inf, steer_tolerance_rad=np.inf)
    plant = replace(plant, car=replace(plant.car, steering=fast, gate=gate))
    t, lag = np.arange(len(window.steer)) * STEP_S, 2 / FAST_SERVO_RADPS
    body, brakes = plant.car.body, plant.car.force
    front = brakes.front.brake_n / (brakes.front.brake_n + brakes.rear.brake_n)
    steer, speed, ax = (x[:, 0] for x in (window.steer, window.vx, window.ax))

    def law(due, vx):
        force = body.mass_kg * np.interp(due, t, ax)
        force += SPEED_GAIN_NSPM * (np.interp(due, t, speed) - vx)
        force = float(force + body.air_density_kgpm3 / 2 * body.drag_area_m2 * vx**2)
        braking = force * front, force * (1 - front)
        forces = split_drive_force(plant.car, force) if force > 0 else braking
        return SetPoints(float(np.interp(due + lag, t, steer)), *forces)

    run = Run('log', float(speed[0]), t[-1] + 2 * MODEL_STEP_S, law)
    track = drive(run, Case(plant, 1.0, load_settings()))
    rows = np.maximum(np.arange(len(t)) * MS_PER_STEP - 1, 0)  # the first one is at 1 ms
    columns = ('planar.vy', 'planar.r', 'acceleration.ay')
    vy, r, ay = (track.column(name)[rows, None] for name in columns)
    return window._replace(vy=vy, r=r, ay=ay)
