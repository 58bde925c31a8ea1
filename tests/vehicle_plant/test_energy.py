"""What the car stores is what flowed in and was not lost: over every manoeuvre, from its record.

The books are kept here from textbook terms alone, and share no code with the equations.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from msgs_yaml.types import WHEELS
from vehicle_plant import parameters
from vehicle_plant.manoeuvre import MANOEUVRES
from vehicle_plant.manoeuvres import procedure, settings

BALANCE = 1e-5  # of the energy exchanged; what is left is the quadrature over 1 ms rows


class Place(NamedTuple):
    """Where a wheel is."""

    axle: object  # parameters.Axle
    x: float  # m from the CoG, forward
    y: float  # m, left


def places(car):
    front, rear = car.suspension.front, car.suspension.rear
    return {
        w: Place(
            front if w[0] == 'f' else rear,
            car.body.cog_to_front_m if w[0] == 'f' else -car.body.cog_to_rear_m,
            (front if w[0] == 'f' else rear).track_m / 2 * (1 if w[1] == 'l' else -1),
        )
        for w in WHEELS
    }


def weights(car):
    """Return the load of each wheel at standstill [N]."""
    body = car.body
    wheelbase = body.cog_to_front_m + body.cog_to_rear_m
    return {
        w: body.mass_kg * body.gravity_mps2 * (wheelbase - abs(at.x)) / wheelbase / 2
        for w, at in places(car).items()
    }


def travel(track, w, at):
    """Return compression and its rate of one corner."""
    body = (('z', 'phi', 'theta'), ('vz', 'p', 'q'))
    return [
        track.column(f'wheels.{w}.{name}')
        - sum(
            arm * track.column(f'ride.{n}') for arm, n in zip((1, at.y, -at.x), names, strict=True)
        )
        for name, names in zip(('z', 'vz'), body, strict=True)
    ]


def stored(track, car):
    """Return kinetic energy, that of springs and tyres, and that of the raised body [J]."""
    body, front, rear = car.body, car.suspension.front, car.suspension.rear
    unsprung = 2 * (front.unsprung_mass_kg + rear.unsprung_mass_kg)
    sprung = body.mass_kg - unsprung
    wheelbase = body.cog_to_front_m + body.cog_to_rear_m

    def arm(of):
        height = of(front) * body.cog_to_rear_m + of(rear) * body.cog_to_front_m
        return body.cog_height_m - height / wheelbase

    moving = (
        ('planar.vx', body.mass_kg),
        ('planar.vy', body.mass_kg),
        ('planar.r', body.yaw_inertia_kgm2),
        ('ride.vz', sprung),
        ('ride.p', body.roll_inertia_kgm2),
        ('ride.q', body.pitch_inertia_kgm2),
    )
    E = sum(inertia / 2 * track.column(name) ** 2 for name, inertia in moving)
    weight = sprung * body.gravity_mps2
    E -= weight / 2 * arm(lambda a: a.roll_centre_height_m) * track.column('ride.phi') ** 2
    E -= weight / 2 * arm(lambda a: a.pitch_centre_height_m) * track.column('ride.theta') ** 2
    travels = {}
    for w, at in places(car).items():
        travels[w], _ = travel(track, w, at)
        E += at.axle.unsprung_mass_kg / 2 * track.column(f'wheels.{w}.vz') ** 2
        E += car.wheel.spin_inertia_kgm2 / 2 * track.column(f'wheels.{w}.omega') ** 2
        E += car.wheel.vertical_stiffness_npm / 2 * track.column(f'wheels.{w}.z') ** 2
        E += at.axle.ride_rate_npm / 2 * travels[w] ** 2
    for axle, left, right in ((front, 'fl', 'fr'), (rear, 'rl', 'rr')):
        E += axle.antiroll_npm / 2 * (travels[left] - travels[right]) ** 2
    return E


def steered(track, car):
    """Return the angle of the front and of the rear wheels: rack, roll and compliance."""
    angles = {'f': track.column('servos.steer.position'), 'r': 0.0}
    for end, sign, axle in (('f', -1, car.suspension.front), ('r', 1, car.suspension.rear)):
        Fy = track.column(f'loads.{end}l.Fy') + track.column(f'loads.{end}r.Fy')
        yielded = axle.roll_steer * track.column('ride.phi') + axle.compliance_steer_radpn * Fy
        angles[end] = angles[end] + sign * yielded
    return angles


def powers(track, car):
    """Return the power that each part puts in [W]; losses are negative."""
    body, wheel = car.body, car.wheel
    vx, vy, r = (track.column(f'planar.{name}') for name in ('vx', 'vy', 'r'))
    angles = steered(track, car)
    speed = np.hypot(vx, vy)
    P = {'drag': -body.air_density_kgpm3 / 2 * body.drag_area_m2 * speed**3}
    for part in ('tyres', 'brakes and drive', 'rolling resistance', 'dampers', 'lift'):
        P[part] = np.zeros_like(vx)
    static = weights(car)
    for w, at in places(car).items():
        omega, windup, vz = (track.column(f'wheels.{w}.{n}') for n in ('omega', 'windup', 'vz'))
        Fx, Fy, Fz, torque = (track.column(f'loads.{w}.{n}') for n in ('Fx', 'Fy', 'Fz', 'torque'))
        delta = angles[w[0]]
        _, rate = travel(track, w, at)
        Vx = vx - at.y * r - body.cog_height_m * track.column('ride.q')
        Vx += at.axle.pitch_centre_height_m / at.x * rate
        Vy = vy + at.x * r + body.cog_height_m * track.column('ride.p')
        Vy += at.axle.roll_centre_height_m / at.y * rate
        along = Vx * np.cos(delta) + Vy * np.sin(delta)
        across = Vy * np.cos(delta) - Vx * np.sin(delta)
        P['tyres'] += Fx * (along - omega * wheel.radius_m) + Fy * across
        P['brakes and drive'] += torque * omega
        # it rolls against what the lining lets through, which is all but around standstill
        grip = np.clip(windup + omega * car.brake.damping_s / car.brake.windup_rad, -1, 1)
        P['rolling resistance'] -= wheel.rolling_resistance * Fz * wheel.radius_m * omega * grip
        P['dampers'] -= at.axle.damper_rate_nspm * rate**2
        # what the road gives to the wheel beside the tyre's spring: its damping, or the missing
        # pull of a tyre that has lifted off
        spring = static[w] - wheel.vertical_stiffness_npm * track.column(f'wheels.{w}.z')
        P['dampers'] += (Fz - spring) * vz
        area = body.front_lift_area_m2 if w[0] == 'f' else body.rear_lift_area_m2
        up = track.column('ride.vz') - at.x * track.column('ride.q')
        P['lift'] += body.air_density_kgpm3 / 2 * speed**2 * area / 2 * up
    return P


def imbalance(track, car):
    """Return the greatest error of the balance over the greatest energy that changed hands [-]."""
    t, E = procedure.times(track), stored(track, car)
    work = {part: cumulative_trapezoid(P, t, initial=0) for part, P in powers(track, car).items()}
    error = E - E[0] - sum(work.values())
    exchanged = sum(np.abs(W).max() for W in work.values())
    return float(np.abs(error).max() / exchanged), work


@pytest.mark.parametrize('friction', [1.0, 0.4])
@pytest.mark.parametrize('name', MANOEUVRES)
def test_energy_balances_over_the_manoeuvre(name, friction):
    case = procedure.Case(parameters.load(), friction, settings.load())
    for run in MANOEUVRES[name].runs(case):
        error, work = imbalance(procedure.drive(run, case), case.plant.car)
        assert error < BALANCE, (run.label, error)
        # drag, rolling resistance and dampers only take, and so do tyres in the long run
        for part in ('drag', 'rolling resistance', 'tyres'):
            assert work[part][-1] < 0, (run.label, part)


def test_energy_balances_in_a_car_with_lift_and_wheels_that_steer_by_themselves():
    params = parameters.load()
    axles = params.car.suspension
    steering = {'roll_steer': 0.05, 'compliance_steer_radpn': 3e-7}
    car = replace(
        params.car,
        body=replace(params.car.body, front_lift_area_m2=0.1, rear_lift_area_m2=0.3),
        suspension=replace(
            axles, front=replace(axles.front, **steering), rear=replace(axles.rear, **steering)
        ),
    )
    case = procedure.Case(replace(params, car=car), 1.0, settings.load())
    run = MANOEUVRES['sine_with_dwell'].runs(case)[-1]
    track = procedure.drive(run, case)
    assert imbalance(track, car)[0] < BALANCE
    assert imbalance(track, params.car)[0] > 10 * BALANCE


def test_one_percent_of_mass_would_be_missed():
    case = procedure.Case(parameters.load(), 1.0, settings.load())
    (run,) = MANOEUVRES['straight_braking'].runs(case)
    track = procedure.drive(run, case)
    body = case.plant.car.body
    heavier = replace(case.plant.car, body=replace(body, mass_kg=1.01 * body.mass_kg))
    assert imbalance(track, heavier)[0] > 100 * BALANCE
