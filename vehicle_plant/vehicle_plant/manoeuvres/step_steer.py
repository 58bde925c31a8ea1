"""Step steer, ISO 7401: lateral transient response; drive force held.

Times count from the instant at which the road wheels have reached half their angle: response time
to 90 % of the steady state, peak response time to the peak. Rise time is that from 10 to 90 %.
"""

import numpy as np
from matplotlib.figure import Figure

from vehicle_plant.manoeuvres import linear_single_track, procedure
from vehicle_plant.manoeuvres.procedure import Case, Number, Run
from vehicle_plant.state import SetPoints, Trajectory

SIGNALS = {'yaw_rate': 'planar.r', 'ay': 'acceleration.ay'}


def runs(case: Case) -> tuple[Run, ...]:
    """Return the one run; its angle is that of the linear single track."""
    p, settle = case.settings.step_steer, case.settings.settle_s
    car = linear_single_track.linear_car(case.plant, case.friction)
    angle = car.steer(case.scaled(p.ay_mps2), p.speed_mps)
    plant = case.plant.car
    forces = procedure.split_drive_force(plant, procedure.driving_resistance(plant, p.speed_mps))

    def law(t, vx):
        return SetPoints(angle * min(max((t - settle) / p.rise_s, 0.0), 1.0), *forces)

    return (Run(f'{np.degrees(angle):.2f} deg', p.speed_mps, settle + p.seconds, law),)


def _steady(case: Case, t: np.ndarray, y: np.ndarray) -> float:
    """Return the mean in the steady state."""
    begin = case.settings.settle_s + case.settings.step_steer.steady_from_s
    return float(y[t >= begin].mean())


def numbers(case: Case, _, tracks: list[Trajectory]) -> dict[str, Number]:
    """Return times and overshoots of yaw rate and lateral acceleration."""
    (track,) = tracks
    t, steer = procedure.times(track), track.column('servos.steer.position')
    half = procedure.first_crossing_time(t, steer, procedure.HALF * _steady(case, t, steer))
    result = {}
    for name, column in SIGNALS.items():
        y = track.column(column)
        steady = _steady(case, t, y)
        low, high = (
            procedure.first_crossing_time(t, y, part * steady)
            for part in (procedure.LOW, procedure.HIGH)
        )
        unit = 'rad/s' if name == 'yaw_rate' else 'm/s^2'
        result |= {
            f'{name}_steady': Number(steady, unit, 'mean in the steady state'),
            f'{name}_rise_time': Number(high - low, 's', '10 to 90 % of the steady state'),
            f'{name}_response_time': Number(high - half, 's', 'half the steer to 90 %'),
            f'{name}_peak_time': Number(float(t[np.argmax(y)]) - half, 's', 'half the steer to it'),
            f'{name}_overshoot': Number(float(y.max()) / steady - 1, '-', 'of the steady state'),
        }
    gain = result['yaw_rate_steady'].value / _steady(case, t, steer)
    vx = _steady(case, t, track.column('planar.vx'))
    result['yaw_rate_gain'] = Number(gain, '1/s', 'steady yaw rate over road-wheel angle')
    result['steady_speed'] = Number(vx, 'm/s', 'mean in the steady state')
    return result


def draw(case: Case, chosen: tuple[Run, ...], tracks: list[Trajectory]) -> Figure:
    """Return steer, yaw rate, lateral acceleration and attitude over time."""
    (track,), settle = tracks, case.settings.settle_s
    t = procedure.times(track) - settle
    figure = Figure(figsize=(10, 7), layout='constrained')
    panels = figure.subplots(2, 2, sharex=True).ravel()
    beta = np.arctan2(track.column('planar.vy'), track.column('planar.vx'))
    curves = (
        ('road-wheel angle [deg]', np.degrees(track.column('servos.steer.position'))),
        ('yaw rate [deg/s]', np.degrees(track.column('planar.r'))),
        ('lateral acceleration [m/s²]', track.column('acceleration.ay')),
        ('angle [deg]', np.degrees(track.column('ride.phi'))),
    )
    for axes, (label, y) in zip(panels, curves):
        axes.plot(t, y, label='roll' if label.startswith('angle') else 'plant')
        axes.set_ylabel(label)
        axes.grid()
    for axes, (_, y) in zip(panels[1:3], curves[1:3]):
        steady = _steady(case, t + settle, y)
        for part in (procedure.LOW, procedure.HIGH, 1):
            axes.axhline(part * steady, color='k', linestyle=':', linewidth=1)
        axes.text(t[-1], steady, 'steady', ha='right', va='bottom')
    panels[-1].plot(t, np.degrees(beta), label='side slip of the CoG')
    panels[-1].legend()
    for axes in panels[2:]:
        axes.set_xlabel('time since the step [s]')
    panels[0].set_xlim(-settle / 2, t[-1])
    figure.suptitle(
        f'Step steer (ISO 7401) to {chosen[0].label} at {chosen[0].speed:.1f} m/s, '
        f'friction {case.friction:g}; dotted: 10, 90 and 100 %'
    )
    return figure
