"""Sine with dwell after FMVSS 126 (49 CFR 571.126, S5.2 and S7): lateral stability and agility.

The rule is written for cars with electronic stability control; this car has none, so large
amplitudes may fail it: the numbers then say from which one on.
"""

import numpy as np
from matplotlib.figure import Figure

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


def judged(case: Case, track: Trajectory) -> tuple[float, float, float]:
    """Return yaw rate left over its peak, early and late, and the lateral displacement [m].

    The peak is the greatest yaw rate after the steer has changed its sign.
    """
    p = case.settings.sine_with_dwell
    t = procedure.times(track) - case.settings.settle_s
    r = track.column('planar.r')
    turned = 1 / (2 * p.frequency_hz)
    done = 1 / p.frequency_hz + p.dwell_s
    peak = r[(t > turned) & (t < done + p.early_s)].min()
    left = (procedure.value_at(t, r, done + after) / peak for after in (p.early_s, p.late_s))
    return *left, procedure.value_at(t, track.column('planar.Y'), p.displaced_s)


def numbers(case: Case, chosen: tuple[Run, ...], tracks: list[Trajectory]) -> dict[str, Number]:
    """Return the three criteria at each amplitude, and up to which one all are met."""
    p = case.settings.sine_with_dwell
    result, passed, still = {}, 0.0, True
    for amplitude, track in zip(p.amplitudes, tracks):
        early, late, displaced = judged(case, track)
        enough = amplitude < p.displaced_from or displaced >= p.displacement_m
        still = still and early <= p.early_ratio and late <= p.late_ratio and enough
        passed = amplitude if still else passed
        end = f'at_{amplitude:g}'
        result |= {
            f'yaw_rate_left_early_{end}': Number(
                early, '-', f'of its peak, {p.early_s:g} s after steer, <= {p.early_ratio:g}'
            ),
            f'yaw_rate_left_late_{end}': Number(
                late, '-', f'of its peak, {p.late_s:g} s after steer, <= {p.late_ratio:g}'
            ),
            f'displacement_{end}': Number(
                displaced, 'm', f'{p.displaced_s:g} s into steer, >= {p.displacement_m:g}'
            ),
        }
    unit = float(tracks[0].column('servos.steer.position').max()) / p.amplitudes[0]
    result['unit_steer'] = Number(unit, 'rad', 'road-wheel angle of amplitude 1, as reached')
    result['passed_up_to'] = Number(passed, '-', 'amplitude up to which all criteria are met')
    return result


def draw(case: Case, chosen: tuple[Run, ...], tracks: list[Trajectory]) -> Figure:
    """Return steer, yaw rate and path of all amplitudes, and the criteria over the amplitude."""
    p, settle = case.settings.sine_with_dwell, case.settings.settle_s
    figure = Figure(figsize=(12, 7), layout='constrained')
    (steer, ratio), (yaw_rate, path) = figure.subplots(2, 2)
    # from a pale to a dark blue
    shades = [(0.75 * (1 - s), 0.8 * (1 - s), 1 - 0.4 * s) for s in np.linspace(0, 1, len(tracks))]
    for run, track, shade in zip(chosen, tracks, shades):
        t = procedure.times(track) - settle
        style = {'color': shade, 'label': run.label}
        steer.plot(t, np.degrees(track.column('servos.steer.position')), **style)
        yaw_rate.plot(t, np.degrees(track.column('planar.r')), **style)
        path.plot(track.column('planar.X'), track.column('planar.Y'), **style)
    done = 1 / p.frequency_hz + p.dwell_s
    for after in (p.early_s, p.late_s):
        yaw_rate.axvline(done + after, color='k', linestyle=':')
    steer.set_ylabel('road-wheel angle [deg]')
    yaw_rate.set_ylabel('yaw rate [deg/s]')
    for axes in (steer, yaw_rate):
        axes.set_xlabel('time since the beginning of steer [s]')
    path.set_xlabel('X [m]')
    path.set_ylabel('Y [m]')
    steer.legend(title='amplitude', ncols=2, fontsize='small')
    early, late, displaced = zip(*(judged(case, track) for track in tracks))
    curves = (
        (early, p.early_ratio, f'yaw rate left after {p.early_s:g} s'),
        (late, p.late_ratio, f'yaw rate left after {p.late_s:g} s'),
        (displaced, p.displacement_m, f'displacement after {p.displaced_s:g} s [m]'),
    )
    for number, (y, limit, label) in enumerate(curves):
        (line,) = ratio.plot(p.amplitudes, y, 'o-', label=label, color=f'C{number}')
        ratio.axhline(limit, color=line.get_color(), linestyle=':')
    ratio.set_xlabel(f'amplitude over the steer for {case.scaled(p.unit_ay_mps2):.2f} m/s² [-]')
    ratio.set_ylabel('of the peak [-], displacement [m]')
    ratio.legend()
    for axes in (steer, yaw_rate, path, ratio):
        axes.grid()
    figure.suptitle(
        f'Sine with dwell (FMVSS 126) at {p.speed_mps:.1f} m/s, friction {case.friction:g}; '
        'dotted: limits'
    )
    return figure
