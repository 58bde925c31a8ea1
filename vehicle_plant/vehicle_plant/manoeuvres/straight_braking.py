"""Straight-line braking to standstill with constant brake forces below the limit (no ABS).

Closed form: M v' = -(F + k v^2), F = brakes and rolling resistance, k = drag, M = mass with the
wheels' spin inertia J / R^2, hence from v to standstill s = M / (2 k) ln(1 + k v^2 / F) and
t = M / sqrt(F k) atan(v sqrt(k / F)); without drag s = M v^2 / (2 F) and t = M v / F. The mean
fully developed deceleration is that of UN R13-H: from 80 to 10 % of the initial speed.
"""

from typing import NamedTuple

import numpy as np

from msgs_yaml.types import WHEELS
from vehicle_plant.manoeuvres import procedure
from vehicle_plant.manoeuvres.procedure import Case, Number, Run
from vehicle_plant.state import SetPoints, Trajectory

FULL_FROM, FULL_TO = 0.8, 0.1  # of the initial speed
FULL_BRAKE_SHARE = 0.99  # of the brake force


class ClosedForm(NamedTuple):
    """Constants of the equation."""

    M: float  # kg
    F: float  # N
    k: float  # N/(m/s)^2

    def distance(self, v):
        """Return the distance to standstill [m]."""
        if not self.k:
            return self.M * v**2 / (2 * self.F)
        return self.M / (2 * self.k) * np.log1p(self.k * v**2 / self.F)

    def duration(self, v):
        """Return the time to standstill [s]."""
        if not self.k:
            return self.M * v / self.F
        return self.M / np.sqrt(self.F * self.k) * np.arctan(v * np.sqrt(self.k / self.F))


def brake_forces(case: Case, deceleration: float, front_share: float) -> tuple[float, float]:
    """Return the axle forces for a deceleration [N], negative."""
    total = -case.plant.car.body.mass_kg * case.scaled(deceleration)
    return front_share * total, (1 - front_share) * total


def closed_form(case: Case) -> ClosedForm:
    """Return the constants for this case."""
    p, car = case.settings.straight_braking, case.plant.car
    body, wheel = car.body, car.wheel
    brakes = -sum(brake_forces(case, p.deceleration_mps2, p.front_share))
    return ClosedForm(
        M=body.mass_kg + len(WHEELS) * wheel.spin_inertia_kgm2 / wheel.radius_m**2,
        F=brakes + procedure.driving_resistance(car, 0.0),
        k=body.air_density_kgpm3 / 2 * body.drag_area_m2,
    )


def runs(case: Case) -> tuple[Run, ...]:
    """Return the only run; it lasts until the car has stood for a while."""
    p, settle = case.settings.straight_braking, case.settings.settle_s
    forces = brake_forces(case, p.deceleration_mps2, p.front_share)
    hold = procedure.hold_speed(case, p.speed_mps)

    def law(t, vx):
        return SetPoints(0.0, *(forces if t > settle else hold(vx)))

    seconds = settle + max(p.seconds, 1.5 * float(closed_form(case).duration(p.speed_mps)))
    return (Run(f'{case.scaled(p.deceleration_mps2):g} m/s²', p.speed_mps, seconds, law),)


def numbers(case: Case, _, trajectories: list[Trajectory]) -> dict[str, Number]:
    """Return distances of the plant and of the closed form, and the deceleration."""
    (trajectory,), p = trajectories, case.settings.straight_braking
    settle_s, column = case.settings.settle_s, trajectory.column
    t, X, vx = procedure.times(trajectory), column('planar.X'), column('planar.vx')
    begin = round(settle_s * procedure.MS_PER_S)
    force = column('servos.front.position') + column('servos.rear.position')
    wanted = sum(brake_forces(case, p.deceleration_mps2, p.front_share))
    full = int(np.flatnonzero(force > FULL_BRAKE_SHARE * wanted)[-1]) + 1
    end = int(np.flatnonzero(vx <= 0)[0])  # stands
    high, low = FULL_FROM * p.speed_mps, FULL_TO * p.speed_mps
    X_high, X_low = (float(np.interp(-v, -vx[full:end], X[full:end])) for v in (high, low))
    distance, expected = X[end] - X[full], float(closed_form(case).distance(vx[full]))
    creep = np.abs(vx[t > t[-1] - settle_s]).max()
    slip = max(-column(f'wheels.{w}.kappa')[full:end].min() for w in WHEELS)
    return {
        'stopping_distance': Number(float(X[end] - X[begin]), 'm', 'from the brake command'),
        'stopping_time': Number(float(t[end] - t[begin]), 's', 'from the brake command'),
        'full_braking_distance': Number(float(distance), 'm', 'from the full brake force'),
        'full_braking_closed_form': Number(expected, 'm', 'M / (2 k) ln(1 + k v^2 / F)'),
        'distance_error': Number(float(distance / expected - 1), '-', 'plant over closed form'),
        'mean_full_deceleration': Number(
            (high**2 - low**2) / (2 * (X_low - X_high)), 'm/s^2', '80 to 10 % of the speed'
        ),
        'creep': Number(float(creep), 'm/s', 'speed left while standing'),
        'greatest_slip': Number(float(slip), '-', 'of any wheel'),
    }
