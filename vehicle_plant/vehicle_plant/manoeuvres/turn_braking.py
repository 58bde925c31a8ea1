"""Braking in a turn, ISO 7975: from a steady circle, brakes at several levels, steering held.

Judged one second after the brakes: yaw rate over that of the initial radius at the speed left,
r / (V / R); above 1 the car turns in, below 1 it runs wide. Beside it side slip, distance of the
CoG outside its circle, and whether a wheel locks: the car has no ABS.
"""

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from msgs_yaml.types import WHEELS
from vehicle_plant.manoeuvres import procedure, steady_circle
from vehicle_plant.manoeuvres.procedure import Case, Number, Run
from vehicle_plant.manoeuvres.straight_braking import brake_forces
from vehicle_plant.state import Planar, SetPoints, Trajectory


def _begin(case: Case) -> float:
    """Return the instant of the brakes [s]."""
    p = case.settings.turn_braking
    return case.settings.settle_s + p.steer_rise_s + p.circle_s


def runs(case: Case) -> tuple[Run, ...]:
    """Return one run per level of braking."""
    p, settle = case.settings.turn_braking, case.settings.settle_s
    ay = case.scaled(p.ay_mps2)
    speed = float(np.sqrt(ay * p.radius_m))
    angle = steady_circle.steer_at(case, speed, ay)
    hold, begin = procedure.hold_speed(case, speed), _begin(case)

    def braking(deceleration):
        forces = brake_forces(case, deceleration, p.front_share)

        def law(t, vx):
            steer = angle * min(max((t - settle) / p.steer_rise_s, 0.0), 1.0)
            return SetPoints(steer, *(forces if t > begin else hold(vx)))

        return law

    return tuple(
        Run(f'{case.scaled(a):g} m/s²', speed, begin + p.seconds, braking(a))
        for a in p.decelerations_mps2
    )


class Motion(NamedTuple):
    """What is judged, one value per row."""

    t: np.ndarray  # s since the brakes
    ratio: np.ndarray  # -, yaw rate over V / R
    beta: np.ndarray  # rad, side slip
    outside: np.ndarray  # m, distance of the CoG outside the circle


def _motion(case: Case, track: Trajectory) -> Motion:
    t = procedure.times(track) - _begin(case)
    X, Y, psi, vx, vy, r = (track.column(f'planar.{n}') for n in Planar._fields)
    V, beta = np.hypot(vx, vy), np.arctan2(vy, vx)
    before = round(_begin(case) * procedure.MS_PER_S) - 1
    R = V[before] / r[before]
    heading = psi[before] + beta[before]
    centre = X[before] - R * np.sin(heading), Y[before] + R * np.cos(heading)
    return Motion(t, r * R / V, beta, np.hypot(X - centre[0], Y - centre[1]) - abs(R))


def numbers(case: Case, chosen: tuple[Run, ...], tracks: list[Trajectory]) -> dict[str, Number]:
    """Return the judgement at each level."""
    p = case.settings.turn_braking
    before = round(_begin(case) * procedure.MS_PER_S) - 1
    vx, vy, r, ay = (
        float(tracks[0].column(n)[before])
        for n in ('planar.vx', 'planar.vy', 'planar.r', 'acceleration.ay')
    )
    result = {
        'initial_radius': Number(float(np.hypot(vx, vy) / r), 'm', 'V / r before the brakes'),
        'initial_ay': Number(ay, 'm/s^2', 'lateral acceleration before the brakes'),
    }
    for level, run, track in zip(p.decelerations_mps2, chosen, tracks):
        m = _motion(case, track)
        t, within = m.t, (m.t > 0) & (m.t <= p.judged_s)
        slip = min(track.column(f'wheels.{w}.kappa')[within].min() for w in WHEELS)
        lost = float(np.hypot(vx, vy)) - procedure.value_at(
            t, np.hypot(track.column('planar.vx'), track.column('planar.vy')), p.judged_s
        )
        end = f'at_{level:g}'
        when = f'{p.judged_s:g} s after braking with {run.label} begins'
        result |= {
            f'mean_deceleration_{end}': Number(lost / p.judged_s, 'm/s^2', f'over the {when}'),
            f'yaw_rate_ratio_{end}': Number(procedure.value_at(t, m.ratio, p.judged_s), '-', when),
            f'sideslip_{end}': Number(procedure.value_at(t, m.beta, p.judged_s), 'rad', when),
            f'outside_{end}': Number(procedure.value_at(t, m.outside, p.judged_s), 'm', when),
            f'greatest_yaw_rate_ratio_{end}': Number(
                float(m.ratio[within].max()), '-', f'within {when}'
            ),
            f'greatest_brake_slip_{end}': Number(float(-slip), '-', 'of any wheel till then'),
        }
    return result


def draw(case: Case, chosen: tuple[Run, ...], tracks: list[Trajectory]) -> Figure:
    """Return yaw-rate ratio, distance to the circle, side slip and speed over time."""
    p = case.settings.turn_braking
    figure = Figure(figsize=(11, 7), layout='constrained')
    (turning, wide), (slip, speed) = figure.subplots(2, 2)
    for run, track in zip(chosen, tracks):
        m = _motion(case, track)
        seen = m.t > -p.judged_s / 2
        t = m.t[seen]
        turning.plot(t, m.ratio[seen], label=run.label)
        wide.plot(t, m.outside[seen])
        slip.plot(t, np.degrees(m.beta[seen]))
        speed.plot(t, track.column('planar.vx')[seen])
    for axes in (turning, wide, slip, speed):
        axes.axvline(p.judged_s, color='k', linestyle=':')
        axes.set_xlabel('time since the brake command [s]')
        axes.grid()
    turning.set_ylabel('yaw rate over V / R [-]')
    slip.set_ylabel('side slip of the CoG [deg]')
    speed.set_ylabel('speed [m/s]')
    wide.set_ylabel('CoG outside its circle [m]')
    turning.legend(title='braking')
    figure.suptitle(
        f'Braking in a turn (ISO 7975), {p.radius_m:g} m at {chosen[0].speed:.1f} m/s, '
        f'friction {case.friction:g}; dotted: judged'
    )
    return figure
