"""Steady-state circle, ISO 4138: constant speed, steer that increases slowly until the car slides.

Understeer gradient: slope of delta - L r / V over lateral acceleration.
"""

from functools import partial
from math import degrees
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from vehicle_plant.circular_driving import axle_points
from vehicle_plant.manoeuvres import linear_single_track, procedure
from vehicle_plant.manoeuvres.linear_single_track import LinearCar
from vehicle_plant.manoeuvres.procedure import Case, Number, Run
from vehicle_plant.state import SetPoints, Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SLIDING = 0.98  # of the greatest lateral acceleration so far: the car slides for good


def ramp(case: Case, speed: float) -> Run:
    """Return the run at a speed [m/s]."""
    p, settle = case.settings.steady_circle, case.settings.settle_s
    hold = procedure.hold_speed(case, speed)

    def law(t, vx):
        steer = np.clip((t - settle) * p.steer_rate_radps, 0.0, p.last_steer_rad)
        return SetPoints(float(steer), *hold(vx))

    seconds = settle + p.last_steer_rad / p.steer_rate_radps
    return Run(f'{speed:.1f} m/s', speed, seconds, law)


def steer_at(case: Case, speed: float, ay: float) -> float:
    """Return the road-wheel angle [rad] for a lateral acceleration at a speed, from such a run.

    Raises ValueError when the car does not reach it.
    """
    trajectory = procedure.drive(ramp(case, speed), case)
    gripping = _gripping_rows(case, trajectory)
    reached = trajectory.column('acceleration.ay')[gripping]
    if reached.max() < ay:
        raise ValueError(f'{reached.max():.2f} m/s^2 at {speed:.1f} m/s, wanted {ay:.2f} m/s^2')
    steer = trajectory.column('servos.steer.position')[gripping]
    return float(np.interp(ay, np.maximum.accumulate(reached), steer))


def _gripping_rows(case: Case, trajectory: Trajectory) -> slice:
    """Return the rows from the beginning of steer until the car slides or spins."""
    begin = round(case.settings.settle_s * procedure.MS_PER_S)
    ay = trajectory.column('acceleration.ay')
    greatest = np.maximum.accumulate(ay)
    linear = case.scaled(case.settings.steady_circle.fit_to_mps2)
    sliding = np.flatnonzero((greatest > linear) & (ay < SLIDING * greatest))
    end = sliding[0] if len(sliding) else len(ay)
    return slice(begin, begin + int(np.argmax(ay[begin:end])) + 1)


def runs(case: Case) -> tuple[Run, ...]:
    """Return the only run."""
    return (ramp(case, case.settings.steady_circle.speed_mps),)


class Points(NamedTuple):
    """The manoeuvre until the car slides, (n,) each."""

    ay: np.ndarray  # m/s^2
    steer: np.ndarray  # rad
    extra: np.ndarray  # rad, steer beyond that of the radius, L r / V
    vx: np.ndarray  # m/s
    beta: np.ndarray  # rad, side slip at the CoG
    phi: np.ndarray  # rad, roll


def _points(case: Case, trajectory: Trajectory) -> Points:
    gripping = trajectory.where(_gripping_rows(case, trajectory))
    vx, vy, r = (gripping.column(f'planar.{name}') for name in ('vx', 'vy', 'r'))
    steer, ay = gripping.column('servos.steer.position'), gripping.column('acceleration.ay')
    wheelbase = linear_single_track.linear_car(case.plant, case.friction).wheelbase
    extra = steer - wheelbase * r / vx
    return Points(ay, steer, extra, vx, np.arctan2(vy, vx), gripping.column('ride.phi'))


def _closed_forms(car: LinearCar, V: float) -> tuple[float, float]:
    """Return the understeer gradient of the single track and that with roll and load transfer."""
    static = np.zeros(1)
    body = linear_single_track.yaw_rate_response(car, V, static, body=True)[0].real
    # r / delta = V / (L + K V^2)
    return car.understeer, 1 / (V * body) - car.wheelbase / V**2


def numbers(case: Case, _, trajectories: list[Trajectory]) -> dict[str, Number]:
    """Return gradients in the linear range and the limit."""
    (trajectory,), p = trajectories, case.settings.steady_circle
    low, high = case.scaled(p.fit_from_mps2), case.scaled(p.fit_to_mps2)
    points = _points(case, trajectory)
    car = linear_single_track.linear_car(case.plant, case.friction)
    K_closed, K_body = _closed_forms(car, p.speed_mps)
    slope = partial(procedure.fit_slope, points.ay, low=low, high=high)
    K = slope(points.extra)
    characteristic = float(np.sqrt(car.wheelbase / K)) if K > 0 else np.nan
    gradient = 'rad/(m/s^2)'
    return {
        'understeer_gradient': Number(K, gradient, 'of the plant in the linear range'),
        'understeer_gradient_single_track': Number(K_closed, gradient, 'm/L (l_r/C_f - l_f/C_r)'),
        'understeer_gradient_with_body': Number(K_body, gradient, 'and roll, load transfer'),
        'characteristic_speed': Number(characteristic, 'm/s', 'sqrt(L / K)'),
        'sideslip_gradient': Number(slope(points.beta), gradient, 'at the CoG'),
        'roll_gradient': Number(slope(points.phi), gradient, 'of the body'),
        'greatest_ay': Number(float(points.ay.max()), 'm/s^2', 'lateral acceleration at the limit'),
        'slowest': Number(float(points.vx.min()), 'm/s', 'until then'),
    }


def draw(case: Case, _, trajectories: list[Trajectory]) -> 'Figure':
    """Return handling diagram, attitude and axle slip."""
    (trajectory,), p = trajectories, case.settings.steady_circle
    points = _points(case, trajectory)
    gripping = trajectory.where(_gripping_rows(case, trajectory))
    ay = points.ay
    car = linear_single_track.linear_car(case.plant, case.friction)
    figure = procedure.new_figure(12, 4)
    left, middle, right = figure.subplots(1, 3)
    left.plot(ay, np.degrees(points.steer), label='steer')
    left.plot(ay, np.degrees(points.extra), label='steer - L r / V')
    line = np.array([0.0, 0.4 * ay.max()])
    K, K_body = _closed_forms(car, p.speed_mps)
    left.plot(line, degrees(K) * line, 'k:', label='linear single track')
    left.plot(line, degrees(K_body) * line, 'k--', label='and roll, load transfer')
    middle.plot(ay, np.degrees(points.phi), label='roll')
    middle.plot(ay, np.degrees(points.beta), label='side slip of the CoG')
    for name, axle in zip(('front', 'rear'), axle_points(gripping, case.plant)):
        right.plot(ay, -np.degrees(axle.alpha), label=f'{name} axle')
    labels = {
        left: 'road-wheel angle [deg]',
        middle: 'angle [deg]',
        right: 'slip angle, to the right [deg]',
    }
    for axes, label in labels.items():
        axes.axvspan(0, case.scaled(p.fit_to_mps2), alpha=0.1, label='linear range')
        procedure.label_axes(axes, label, 'lateral acceleration [m/s²]')
    figure.suptitle(
        f'Steady-state circle (ISO 4138) at {p.speed_mps:.1f} m/s, friction {case.friction:g}'
    )
    return figure
