"""Braking in a turn, ISO 7975: from a steady circle, brakes at several levels, steering held.

Evaluated one second after the brakes: yaw rate over that of the initial radius at the present
speed, r / (V / R); above 1 the car turns in, below 1 it runs wide. Also side slip, distance of the
CoG outside its circle, and whether a wheel locks: the car has no ABS.
"""

import numpy as np

from msgs_yaml.types import WHEELS
from vehicle_plant.manoeuvres import procedure, steady_circle
from vehicle_plant.manoeuvres.procedure import Case, Number, Run
from vehicle_plant.manoeuvres.straight_braking import brake_forces
from vehicle_plant.state import Planar, SetPoints, Trajectory


def _brake_time(case: Case) -> float:
    """Return the instant of the brake command [s]."""
    p = case.settings.turn_braking
    return case.settings.settle_s + p.steer_rise_s + p.circle_s


def runs(case: Case) -> tuple[Run, ...]:
    """Return one run per level of braking."""
    p, settle = case.settings.turn_braking, case.settings.settle_s
    ay = case.scaled(p.ay_mps2)
    speed = float(np.sqrt(ay * p.radius_m))
    angle = steady_circle.steer_at(case, speed, ay)
    hold, brake_s = procedure.hold_speed(case, speed), _brake_time(case)

    def braking(deceleration):
        forces = brake_forces(case, deceleration, p.front_share)

        def law(t, vx):
            steer = angle * min(max((t - settle) / p.steer_rise_s, 0.0), 1.0)
            return SetPoints(steer, *(forces if t > brake_s else hold(vx)))

        return law

    return tuple(
        Run(f'{case.scaled(a):g} m/s²', speed, brake_s + p.seconds, braking(a))
        for a in p.decelerations_mps2
    )


def numbers(case: Case, runs: tuple[Run, ...], trajectories: list[Trajectory]) -> dict[str, Number]:
    """Return the evaluation at each level of braking."""
    p, brake_s = case.settings.turn_braking, _brake_time(case)
    before = round(brake_s * procedure.MS_PER_S) - 1  # row
    result = {}
    for level, run, trajectory in zip(p.decelerations_mps2, runs, trajectories):
        t, column = procedure.times(trajectory) - brake_s, trajectory.column
        X, Y, psi, vx, vy, r = (column(f'planar.{name}') for name in Planar._fields)
        V, beta = np.hypot(vx, vy), np.arctan2(vy, vx)
        R, heading = V[before] / r[before], psi[before] + beta[before]
        # distance of the CoG outside the circle around (X0, Y0)
        X0, Y0 = X[before] - R * np.sin(heading), Y[before] + R * np.cos(heading)
        outside, ratio = np.hypot(X - X0, Y - Y0) - abs(R), r * R / V
        if not result:
            ay = float(column('acceleration.ay')[before])
            result = {
                'initial_radius': Number(float(R), 'm', 'V / r before the brakes'),
                'initial_ay': Number(ay, 'm/s^2', 'lateral acceleration before the brakes'),
            }
            initial_speed = float(V[before])
        within = (t > 0) & (t <= p.judged_s)
        slip = float(-min(column(f'wheels.{w}.kappa')[within].min() for w in WHEELS))
        speed, judged_ratio, judged_beta, judged_outside = (
            float(np.interp(p.judged_s, t, y)) for y in (V, ratio, beta, outside)
        )
        deceleration, greatest = (initial_speed - speed) / p.judged_s, float(ratio[within].max())
        when = f'{p.judged_s:g} s after braking with {run.label} begins'
        result |= {
            f'mean_deceleration_at_{level:g}': Number(deceleration, 'm/s^2', f'over the {when}'),
            f'yaw_rate_ratio_at_{level:g}': Number(judged_ratio, '-', when),
            f'sideslip_at_{level:g}': Number(judged_beta, 'rad', when),
            f'outside_at_{level:g}': Number(judged_outside, 'm', when),
            f'greatest_yaw_rate_ratio_at_{level:g}': Number(greatest, '-', f'within {when}'),
            f'greatest_brake_slip_at_{level:g}': Number(slip, '-', 'of any wheel till then'),
        }
    return result
