"""Sine sweep, ISO 7401: frequency response from the road-wheel angle to the yaw rate below 0.2 g.

One sine after the other, each begun at zero and driven for whole periods. Input and output are
fitted by a sine of that frequency after settling; the input is the measured road-wheel angle, so
the servo has no effect.
"""

from math import ceil
from typing import NamedTuple

import numpy as np

from vehicle_plant.manoeuvres import linear_single_track, procedure
from vehicle_plant.manoeuvres.procedure import Case, Number, Run
from vehicle_plant.state import SetPoints, Trajectory

FORMS = {
    'single track': {'relaxation': False},
    'with relaxation': {'relaxation': True},
    'with relaxation and body': {'relaxation': True, 'body': True},
}


class Sine(NamedTuple):
    """A sine of one frequency."""

    f_hz: float
    begin: float  # s
    evaluated: float  # s, from here on
    end: float  # s
    amplitude: float  # rad


def sines(case: Case) -> tuple[Sine, ...]:
    """Return the sines; the linear single track gives the amplitude for the acceleration."""
    p = case.settings.sine_sweep
    car = linear_single_track.linear_car(case.plant, case.friction)
    V, ay = p.speed_mps, case.scaled(p.ay_mps2)
    gain = np.abs(linear_single_track.yaw_rate_response(car, V, p.frequencies_hz))
    # ay = V r neglects the lateral oscillation: never more steer than in the steady state
    angles = np.minimum(ay / (V * gain), car.steer(ay, V))
    begin, result = case.settings.settle_s, []
    for f_hz, angle in zip(p.frequencies_hz, angles.tolist()):
        evaluated = begin + ceil(p.settle_s * f_hz) / f_hz
        end = evaluated + p.periods / f_hz
        result.append(Sine(f_hz, begin, evaluated, end, angle))
        begin = end
    return tuple(result)


def runs(case: Case) -> tuple[Run, ...]:
    """Return one run with all sines."""
    speed = case.settings.sine_sweep.speed_mps
    hold = procedure.hold_speed(case, speed)
    sequence = sines(case)

    def law(t, vx):
        steer = sum(
            s.amplitude * np.sin(2 * np.pi * s.f_hz * (t - s.begin))
            for s in sequence
            if s.begin <= t < s.end
        )
        return SetPoints(float(steer), *hold(vx))

    return (Run('all frequencies', speed, sequence[-1].end, law),)


def response(case: Case, trajectory: Trajectory) -> np.ndarray:
    """Return r / delta [1/s] at the frequencies of the settings, complex, (n,)."""
    t = procedure.times(trajectory)
    signals = trajectory.column('planar.r'), trajectory.column('servos.steer.position')
    result = []
    for s in sines(case):
        inside = (t >= s.evaluated) & (t < s.end)
        r, delta = (procedure.phasor(t[inside], y[inside], s.f_hz) for y in signals)
        result.append(r / delta)
    return np.array(result)


def errors(case: Case, trajectory: Trajectory, form: str, up_to_hz: float) -> tuple[float, float]:
    """Return the greatest differences to a closed form: of the gain [-], of the phase [rad]."""
    p = case.settings.sine_sweep
    f_hz = np.array(p.frequencies_hz)
    car = linear_single_track.linear_car(case.plant, case.friction)
    closed = linear_single_track.yaw_rate_response(car, p.speed_mps, f_hz, **FORMS[form])
    ratio = (response(case, trajectory) / closed)[f_hz <= up_to_hz]
    return float(np.abs(np.abs(ratio) - 1).max()), float(np.abs(np.angle(ratio)).max())


def numbers(case: Case, _, trajectories: list[Trajectory]) -> dict[str, Number]:
    """Return gain and phase at each frequency and the distance to the closed forms."""
    (trajectory,), p = trajectories, case.settings.sine_sweep
    result = {}
    for f_hz, H in zip(p.frequencies_hz, response(case, trajectory)):
        result[f'gain_{f_hz:g}_hz'] = Number(abs(H), '1/s', 'yaw rate over road-wheel angle')
        result[f'phase_{f_hz:g}_hz'] = Number(float(np.angle(H)), 'rad', 'negative: lag')
    last = max(p.frequencies_hz)
    for form in FORMS:
        up_to = last if FORMS[form]['relaxation'] else p.rigid_up_to_hz
        gain, phase = errors(case, trajectory, form, up_to)
        name = form.replace(' ', '_')
        result[f'gain_error_{name}'] = Number(gain, '-', f'greatest up to {up_to:g} Hz')
        result[f'phase_error_{name}'] = Number(phase, 'rad', f'greatest up to {up_to:g} Hz')
    ay = np.abs(trajectory.column('acceleration.ay')).max()
    result['greatest_ay'] = Number(float(ay), 'm/s^2', 'lateral acceleration')
    return result
