"""Sine with dwell after FMVSS 126 (49 CFR 571.126, S5.2 and S7): lateral stability and agility.

The rule is written for cars with electronic stability control; this car has none, so large
amplitudes may fail it: the numbers include the greatest amplitude that passes.
"""

import numpy as np

from vehicle_plant.manoeuvres import procedure, steady_circle
from vehicle_plant.manoeuvres.procedure import Case, Number, Run
from vehicle_plant.state import SetPoints, Trajectory

SECOND_PEAK = 0.75  # of the period


def waveform(t: float, f_hz: float, dwell: float) -> float:
    """Return the steer over its amplitude, t since the beginning of steer."""
    peak, end = SECOND_PEAK / f_hz, 1 / f_hz + dwell
    if not 0 <= t < end:
        return 0.0
    phase = t if t <= peak else max(peak, t - dwell)
    return float(np.sin(2 * np.pi * f_hz * phase))


def runs(case: Case) -> tuple[Run, ...]:
    """Return one run per amplitude, coasting; the unit is the plant's own steer for 0.3 g."""
    p, settle = case.settings.sine_with_dwell, case.settings.settle_s
    unit = steady_circle.steer_at(case, p.speed_mps, case.scaled(p.unit_ay_mps2))
    seconds = settle + 1 / p.frequency_hz + p.dwell_s + p.seconds

    def steering(amplitude):
        def law(t, vx):
            part = waveform(t - settle, p.frequency_hz, p.dwell_s)
            return SetPoints(amplitude * unit * part, 0.0, 0.0)

        return law

    return tuple(Run(f'{a:g}', p.speed_mps, seconds, steering(a)) for a in p.amplitudes)


def criteria(case: Case, trajectory: Trajectory) -> tuple[float, float, float]:
    """Return the remaining yaw rate over its peak, early and late, and the displacement [m].

    The peak is the greatest yaw rate after the steer has changed its sign.
    """
    p = case.settings.sine_with_dwell
    t = procedure.times(trajectory) - case.settings.settle_s
    r = trajectory.column('planar.r')
    reversal = 1 / (2 * p.frequency_hz)
    done = 1 / p.frequency_hz + p.dwell_s
    peak = r[(t > reversal) & (t < done + p.early_s)].min()
    early, late = np.interp([done + p.early_s, done + p.late_s], t, r) / peak
    displacement = np.interp(p.displaced_s, t, trajectory.column('planar.Y'))
    return float(early), float(late), float(displacement)


def numbers(case: Case, _, trajectories: list[Trajectory]) -> dict[str, Number]:
    """Return the three criteria at each amplitude, and up to which one all are met."""
    p = case.settings.sine_with_dwell
    early_text = f'of its peak, {p.early_s:g} s after steer, <= {p.early_ratio:g}'
    late_text = f'of its peak, {p.late_s:g} s after steer, <= {p.late_ratio:g}'
    displacement_text = f'{p.displaced_s:g} s into steer, >= {p.displacement_m:g}'
    result, passed, all_passed = {}, 0.0, True
    for amplitude, trajectory in zip(p.amplitudes, trajectories):
        early, late, displacement = criteria(case, trajectory)
        is_agile = amplitude < p.displaced_from or displacement >= p.displacement_m
        is_stable = early <= p.early_ratio and late <= p.late_ratio
        all_passed = all_passed and is_stable and is_agile
        passed = amplitude if all_passed else passed
        result |= {
            f'yaw_rate_left_early_at_{amplitude:g}': Number(early, '-', early_text),
            f'yaw_rate_left_late_at_{amplitude:g}': Number(late, '-', late_text),
            f'displacement_at_{amplitude:g}': Number(displacement, 'm', displacement_text),
        }
    unit = float(trajectories[0].column('servos.steer.position').max()) / p.amplitudes[0]
    result['unit_steer'] = Number(unit, 'rad', 'road-wheel angle of amplitude 1, as reached')
    result['passed_up_to'] = Number(passed, '-', 'amplitude up to which all criteria are met')
    return result
