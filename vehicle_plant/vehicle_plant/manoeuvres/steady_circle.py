"""Steady-state circle, ISO 4138: constant speed, steer that increases slowly until the car slides.

Understeer gradient: slope of delta - L r / V over lateral acceleration.
"""

from functools import partial

import numpy as np

from vehicle_plant.manoeuvres import linear_single_track, procedure
from vehicle_plant.manoeuvres.procedure import Case, Number, Run
from vehicle_plant.state import SetPoints, Trajectory

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


def numbers(case: Case, _, trajectories: list[Trajectory]) -> dict[str, Number]:
    """Return gradients in the linear range and the limit."""
    (trajectory,), p = trajectories, case.settings.steady_circle
    V, car = p.speed_mps, linear_single_track.linear_car(case.plant, case.friction)
    gripping = trajectory.where(_gripping_rows(case, trajectory))
    vx, vy, r = (gripping.column(f'planar.{name}') for name in ('vx', 'vy', 'r'))
    ay = gripping.column('acceleration.ay')
    extra = gripping.column('servos.steer.position') - car.wheelbase * r / vx
    low, high = case.scaled(p.fit_from_mps2), case.scaled(p.fit_to_mps2)
    slope = partial(procedure.fit_slope, ay, low=low, high=high)
    K, static = slope(extra), np.zeros(1)
    gain = linear_single_track.yaw_rate_response(car, V, static, body=True)[0].real
    # r / delta = V / (L + K V^2)
    K_body = 1 / (V * gain) - car.wheelbase / V**2
    characteristic = float(np.sqrt(car.wheelbase / K)) if K > 0 else np.nan
    unit = 'rad/(m/s^2)'
    return {
        'understeer_gradient': Number(K, unit, 'of the plant in the linear range'),
        'understeer_gradient_single_track': Number(car.understeer, unit, 'm/L (l_r/C_f - l_f/C_r)'),
        'understeer_gradient_with_body': Number(K_body, unit, 'and roll, load transfer'),
        'characteristic_speed': Number(characteristic, 'm/s', 'sqrt(L / K)'),
        'sideslip_gradient': Number(slope(np.arctan2(vy, vx)), unit, 'at the CoG'),
        'roll_gradient': Number(slope(gripping.column('ride.phi')), unit, 'of the body'),
        'greatest_ay': Number(float(ay.max()), 'm/s^2', 'lateral acceleration at the limit'),
        'slowest': Number(float(vx.min()), 'm/s', 'until then'),
    }
