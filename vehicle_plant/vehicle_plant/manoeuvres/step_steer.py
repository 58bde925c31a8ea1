"""Step steer, ISO 7401: lateral transient response; drive force held.

Times count from the instant at which the road wheels have reached half their angle: response time
to 90 % of the steady state, peak response time to the peak. Rise time is that from 10 to 90 %.
"""

import numpy as np

from vehicle_plant.car import split_drive_force
from vehicle_plant.manoeuvres import linear_single_track, procedure
from vehicle_plant.manoeuvres.procedure import Case, Number, Run
from vehicle_plant.state import SetPoints, Trajectory

SIGNALS = {'yaw_rate': 'planar.r', 'ay': 'acceleration.ay'}


def runs(case: Case) -> tuple[Run, ...]:
    """Return the only run; its angle is that of the linear single track."""
    p, settle = case.settings.step_steer, case.settings.settle_s
    car = linear_single_track.linear_car(case.plant, case.friction)
    angle = car.steer(case.scaled(p.ay_mps2), p.speed_mps)
    resistance = procedure.driving_resistance(case.plant.car, p.speed_mps)
    forces = split_drive_force(case.plant.car, resistance)

    def law(t, vx):
        return SetPoints(angle * min(max((t - settle) / p.rise_s, 0.0), 1.0), *forces)

    return (Run(f'{np.degrees(angle):.2f} deg', p.speed_mps, settle + p.seconds, law),)


def _steady(case: Case, t: np.ndarray, y: np.ndarray) -> float:
    """Return the mean in the steady state."""
    begin = case.settings.settle_s + case.settings.step_steer.steady_from_s
    return float(y[t >= begin].mean())


def numbers(case: Case, _, trajectories: list[Trajectory]) -> dict[str, Number]:
    """Return times and overshoots of yaw rate and lateral acceleration."""
    (trajectory,) = trajectories
    t, steer = procedure.times(trajectory), trajectory.column('servos.steer.position')
    half = procedure.first_crossing_time(t, steer, procedure.HALF * _steady(case, t, steer))
    result = {}
    for name, column in SIGNALS.items():
        y = trajectory.column(column)
        steady = _steady(case, t, y)
        low, high = (
            procedure.first_crossing_time(t, y, share * steady)
            for share in (procedure.LOW, procedure.HIGH)
        )
        peak = float(t[np.argmax(y)])
        unit = 'rad/s' if name == 'yaw_rate' else 'm/s^2'
        result |= {
            f'{name}_steady': Number(steady, unit, 'mean in the steady state'),
            f'{name}_rise_time': Number(high - low, 's', '10 to 90 % of the steady state'),
            f'{name}_response_time': Number(high - half, 's', 'half the steer to 90 %'),
            f'{name}_peak_time': Number(peak - half, 's', 'half the steer to it'),
            f'{name}_overshoot': Number(float(y.max()) / steady - 1, '-', 'of the steady state'),
        }
    gain = result['yaw_rate_steady'].value / _steady(case, t, steer)
    vx = _steady(case, t, trajectory.column('planar.vx'))
    result['yaw_rate_gain'] = Number(gain, '1/s', 'steady yaw rate over road-wheel angle')
    result['steady_speed'] = Number(vx, 'm/s', 'mean in the steady state')
    return result
