"""Sine sweep, ISO 7401: frequency response from the road-wheel angle to the yaw rate below 0.2 g.

One sine after the other, each begun at zero and driven for whole periods; input and output are
fitted by a sine of that frequency once the car has settled, so what the servo makes of the command
does not matter.
"""

from math import ceil
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from vehicle_plant.manoeuvres import linear_single_track, procedure
from vehicle_plant.manoeuvres.procedure import Case, Number, Run
from vehicle_plant.state import SetPoints, Trajectory

FORMS = {
    'single track': {'relaxation': False},
    'with relaxation': {'relaxation': True},
    'with relaxation and body': {'relaxation': True, 'body': True},
}


class Sine(NamedTuple):
    """One of the sines."""

    f_hz: float
    begin: float  # s
    counted: float  # s, from here on it is evaluated
    end: float  # s
    amplitude: float  # rad


def sines(case: Case) -> tuple[Sine, ...]:
    """Return the sines; the linear single track says how much steer gives the acceleration."""
    p = case.settings.sine_sweep
    car = linear_single_track.linear_car(case.plant, case.friction)
    V, ay = p.speed_mps, case.scaled(p.ay_mps2)
    gain = np.abs(linear_single_track.yaw_rate_response(car, V, p.frequencies_hz))
    # a turning car has ay = V r, a shaken one more: never more steer than in the steady state
    angles = np.minimum(ay / (V * gain), car.steer(ay, V))
    begin, result = case.settings.settle_s, []
    for f_hz, angle in zip(p.frequencies_hz, angles.tolist()):
        counted = begin + ceil(p.settle_s * f_hz) / f_hz
        end = counted + p.periods / f_hz
        result.append(Sine(f_hz, begin, counted, end, angle))
        begin = end
    return tuple(result)


def runs(case: Case) -> tuple[Run, ...]:
    """Return one run with all sines."""
    speed = case.settings.sine_sweep.speed_mps
    hold = procedure.hold_speed(case, speed)
    driven = sines(case)

    def law(t, vx):
        steer = sum(
            s.amplitude * np.sin(2 * np.pi * s.f_hz * (t - s.begin))
            for s in driven
            if s.begin <= t < s.end
        )
        return SetPoints(float(steer), *hold(vx))

    return (Run('all frequencies', speed, driven[-1].end, law),)


def response(case: Case, track: Trajectory) -> np.ndarray:
    """Return r / delta [1/s] at the frequencies of the settings, complex, (n,)."""
    t = procedure.times(track)
    signals = track.column('planar.r'), track.column('servos.steer.position')
    result = []
    for s in sines(case):
        inside = (t >= s.counted) & (t < s.end)
        r, delta = (procedure.phasor(t[inside], y[inside], s.f_hz) for y in signals)
        result.append(r / delta)
    return np.array(result)


def errors(case: Case, track: Trajectory, form: str, up_to_hz: float) -> tuple[float, float]:
    """Return the greatest differences to a closed form: of the gain [-], of the phase [rad]."""
    p = case.settings.sine_sweep
    f_hz = np.array(p.frequencies_hz)
    car = linear_single_track.linear_car(case.plant, case.friction)
    closed = linear_single_track.yaw_rate_response(car, p.speed_mps, f_hz, **FORMS[form])
    ratio = (response(case, track) / closed)[f_hz <= up_to_hz]
    return float(np.abs(np.abs(ratio) - 1).max()), float(np.abs(np.angle(ratio)).max())


def numbers(case: Case, _, tracks: list[Trajectory]) -> dict[str, Number]:
    """Return gain and phase at each frequency and the distance to the closed forms."""
    (track,), p = tracks, case.settings.sine_sweep
    result = {}
    for f_hz, H in zip(p.frequencies_hz, response(case, track)):
        result[f'gain_{f_hz:g}_hz'] = Number(abs(H), '1/s', 'yaw rate over road-wheel angle')
        result[f'phase_{f_hz:g}_hz'] = Number(float(np.angle(H)), 'rad', 'negative: lag')
    last = max(p.frequencies_hz)
    for form in FORMS:
        up_to = last if FORMS[form]['relaxation'] else p.rigid_up_to_hz
        gain, phase = errors(case, track, form, up_to)
        name = form.replace(' ', '_')
        result[f'gain_error_{name}'] = Number(gain, '-', f'greatest up to {up_to:g} Hz')
        result[f'phase_error_{name}'] = Number(phase, 'rad', f'greatest up to {up_to:g} Hz')
    ay = np.abs(track.column('acceleration.ay')).max()
    result['greatest_ay'] = Number(float(ay), 'm/s^2', 'lateral acceleration')
    return result


def draw(case: Case, _, tracks: list[Trajectory]) -> Figure:
    """Return gain and phase over frequency, and the differences to the closed forms."""
    (track,), p = tracks, case.settings.sine_sweep
    f_hz = np.array(p.frequencies_hz)
    H = response(case, track)
    car = linear_single_track.linear_car(case.plant, case.friction)
    fine = np.geomspace(f_hz[0], f_hz[-1], 200)
    figure = Figure(figsize=(11, 7), layout='constrained')
    (gain, gain_error), (phase, phase_error) = figure.subplots(2, 2, sharex=True)
    for (form, options), style in zip(FORMS.items(), (':', '--', '-')):
        closed = linear_single_track.yaw_rate_response(car, p.speed_mps, fine, **options)
        gain.plot(fine, np.abs(closed), style, label=form)
        phase.plot(fine, np.degrees(np.unwrap(np.angle(closed))), style)
        ratio = H / linear_single_track.yaw_rate_response(car, p.speed_mps, f_hz, **options)
        gain_error.plot(f_hz, 100 * (np.abs(ratio) - 1), 'o' + style, label=f'against {form}')
        phase_error.plot(f_hz, np.degrees(np.angle(ratio)), 'o' + style)
    gain.plot(f_hz, np.abs(H), 'ko', label='plant')
    phase.plot(f_hz, np.degrees(np.unwrap(np.angle(H))), 'ko')
    gain.set_ylabel('yaw rate over road-wheel angle [1/s]')
    phase.set_ylabel('phase [deg]')
    gain_error.set_ylabel('gain of the plant against it [%]')
    phase_error.set_ylabel('phase of the plant against it [deg]')
    gain.legend()
    gain_error.legend()
    for axes, limit in ((gain_error, 3), (phase_error, 5)):
        axes.axhspan(-limit, limit, color='k', alpha=0.08)
    for axes in (gain, gain_error, phase, phase_error):
        axes.set_xscale('log')
        axes.set_xticks(f_hz, [f'{f:g}' for f in f_hz])
        axes.minorticks_off()
        axes.grid()
    for axes in (phase, phase_error):
        axes.set_xlabel('frequency [Hz]')
    ay = np.abs(track.column('acceleration.ay')).max()
    figure.suptitle(
        f'Sine sweep (ISO 7401) at {p.speed_mps:.1f} m/s, up to {ay:.2f} m/s², '
        f'friction {case.friction:g}; grey: 3 % and 5 deg'
    )
    return figure
