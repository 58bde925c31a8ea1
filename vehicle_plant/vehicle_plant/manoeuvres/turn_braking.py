"""Braking in a turn, ISO 7975: from a steady circle, brakes at several levels, steering held.

Evaluated one second after the brakes: yaw rate over that of the initial radius at the present
speed, r / (V / R); above 1 the car turns in, below 1 it runs wide. Also side slip, distance of the
CoG outside its circle, and whether a wheel locks: the car has no ABS.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from msgs_yaml.types import WHEELS
from vehicle_plant.manoeuvres import procedure, steady_circle
from vehicle_plant.manoeuvres.procedure import Case, Number, Run
from vehicle_plant.manoeuvres.straight_braking import brake_forces
from vehicle_plant.state import Planar, SetPoints, Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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


class Motion(NamedTuple):
    """The evaluated quantities, (n,) each."""

    t: np.ndarray  # s since the brake command
    ratio: np.ndarray  # -, yaw rate over V / R
    beta: np.ndarray  # rad, side slip
    outside: np.ndarray  # m, distance of the CoG outside the circle


def _row_before_brakes(case: Case) -> int:
    return round(_brake_time(case) * procedure.MS_PER_S) - 1


def _motion(case: Case, trajectory: Trajectory) -> Motion:
    t = procedure.times(trajectory) - _brake_time(case)
    X, Y, psi, vx, vy, r = (trajectory.column(f'planar.{n}') for n in Planar._fields)
    V, beta = np.hypot(vx, vy), np.arctan2(vy, vx)
    i = _row_before_brakes(case)
    R, heading = V[i] / r[i], psi[i] + beta[i]
    centre = X[i] - R * np.sin(heading), Y[i] + R * np.cos(heading)
    return Motion(t, r * R / V, beta, np.hypot(X - centre[0], Y - centre[1]) - abs(R))


def numbers(case: Case, runs: tuple[Run, ...], trajectories: list[Trajectory]) -> dict[str, Number]:
    """Return the evaluation at each level of braking."""
    p, i = case.settings.turn_braking, _row_before_brakes(case)
    vx, vy, r, ay = (
        float(trajectories[0].column(n)[i])
        for n in ('planar.vx', 'planar.vy', 'planar.r', 'acceleration.ay')
    )
    initial_speed = float(np.hypot(vx, vy))
    result = {
        'initial_radius': Number(float(np.hypot(vx, vy) / r), 'm', 'V / r before the brakes'),
        'initial_ay': Number(ay, 'm/s^2', 'lateral acceleration before the brakes'),
    }
    for level, run, trajectory in zip(p.decelerations_mps2, runs, trajectories):
        m, column = _motion(case, trajectory), trajectory.column
        within = (m.t > 0) & (m.t <= p.judged_s)
        slip = float(-min(column(f'wheels.{w}.kappa')[within].min() for w in WHEELS))
        speed = np.hypot(column('planar.vx'), column('planar.vy'))
        loss = initial_speed - procedure.value_at(m.t, speed, p.judged_s)
        ratio, beta, outside = (
            procedure.value_at(m.t, y, p.judged_s) for y in (m.ratio, m.beta, m.outside)
        )
        greatest, deceleration = float(m.ratio[within].max()), loss / p.judged_s
        when = f'{p.judged_s:g} s after braking with {run.label} begins'
        result |= {
            f'mean_deceleration_at_{level:g}': Number(deceleration, 'm/s^2', f'over the {when}'),
            f'yaw_rate_ratio_at_{level:g}': Number(ratio, '-', when),
            f'sideslip_at_{level:g}': Number(beta, 'rad', when),
            f'outside_at_{level:g}': Number(outside, 'm', when),
            f'greatest_yaw_rate_ratio_at_{level:g}': Number(greatest, '-', f'within {when}'),
            f'greatest_brake_slip_at_{level:g}': Number(slip, '-', 'of any wheel till then'),
        }
    return result


def draw(case: Case, runs: tuple[Run, ...], trajectories: list[Trajectory]) -> 'Figure':
    """Return yaw-rate ratio, distance to the circle, side slip and speed over time."""
    p = case.settings.turn_braking
    figure = procedure.new_figure(11, 7)
    (turning, wide), (slip, speed) = figure.subplots(2, 2)
    for run, trajectory in zip(runs, trajectories):
        m = _motion(case, trajectory)
        shown = m.t > -p.judged_s / 2
        t = m.t[shown]
        turning.plot(t, m.ratio[shown], label=run.label)
        wide.plot(t, m.outside[shown])
        slip.plot(t, np.degrees(m.beta[shown]))
        speed.plot(t, trajectory.column('planar.vx')[shown])
    labels = {
        turning: 'yaw rate over V / R [-]',
        wide: 'CoG outside its circle [m]',
        slip: 'side slip of the CoG [deg]',
        speed: 'speed [m/s]',
    }
    for axes, label in labels.items():
        axes.axvline(p.judged_s, color='k', linestyle=':')
        procedure.label_axes(axes, label, 'time since the brake command [s]', legend=False)
    turning.legend(title='braking')
    figure.suptitle(
        f'Braking in a turn (ISO 7975), {p.radius_m:g} m at {runs[0].speed:.1f} m/s, '
        f'friction {case.friction:g}; dotted: evaluated'
    )
    return figure
