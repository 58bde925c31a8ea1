"""The whole car against mechanics: symmetry, energy, closed forms, the linear single track."""

import numpy as np
import pytest

from msgs_yaml.types import WHEELS
from node_runtime import named_vector
from vehicle_plant import integrator, tyre
from vehicle_plant.initial_state import Start, rolling_state
from vehicle_plant.state import Outputs, State

STATES = named_vector.names(State)
READINGS = named_vector.names(Outputs)


def wild(t, car):
    return 0.15 * np.sin(3 * t), -4000 * max(np.sin(2 * t), 0), -6000 * np.sin(1.3 * t)


def test_mirrored_steering_mirrors_the_motion(drive):
    def mirrored(t, car):
        delta, Fxf, Fxr = wild(t, car)
        return -delta, Fxf, Fxr

    left, right = drive(wild, 3.0, 20.0), drive(mirrored, 3.0, 20.0)
    for name, sign in (('X', 1), ('Y', -1), ('psi', -1), ('vx', 1), ('vy', -1), ('r', -1)):
        a, b = (track.column(f'planar.{name}') for track in (left, right))
        assert np.abs(a - sign * b).max() < 1e-9
    assert np.abs(left.column('loads.fl.Fz') - right.column('loads.fr.Fz')).max() < 1e-6


def energy_and_power(x, readings, rates, params):
    """Return stored energy and the power that flows in, from textbook terms alone."""
    car = params.car
    body, wheel = car.body, car.wheel
    front, rear = car.suspension.front, car.suspension.rear
    unsprung = 2 * (front.unsprung_mass_kg + rear.unsprung_mass_kg)
    sprung = body.mass_kg - unsprung
    arms = np.array([body.cog_to_rear_m, body.cog_to_front_m]) / (
        body.cog_to_rear_m + body.cog_to_front_m
    )
    h_roll = body.cog_height_m - arms @ [front.roll_centre_height_m, rear.roll_centre_height_m]
    h_pitch = body.cog_height_m - arms @ [front.pitch_centre_height_m, rear.pitch_centre_height_m]
    E = body.mass_kg / 2 * (x['planar.vx'] ** 2 + x['planar.vy'] ** 2)
    E += body.yaw_inertia_kgm2 / 2 * x['planar.r'] ** 2 + sprung / 2 * x['ride.vz'] ** 2
    E += body.roll_inertia_kgm2 / 2 * x['ride.p'] ** 2
    E += body.pitch_inertia_kgm2 / 2 * x['ride.q'] ** 2
    weight = sprung * body.gravity_mps2
    E -= weight / 2 * (h_roll * x['ride.phi'] ** 2 + h_pitch * x['ride.theta'] ** 2)
    speed = np.hypot(x['planar.vx'], x['planar.vy'])
    P = -body.air_density_kgpm3 / 2 * body.drag_area_m2 * speed**3
    travels = []
    for w in WHEELS:
        axle, place = (front, body.cog_to_front_m) if w[0] == 'f' else (rear, -body.cog_to_rear_m)
        side = axle.track_m / 2 * (1 if w[1] == 'l' else -1)
        delta = x['servos.steer.position'] if w[0] == 'f' else 0.0
        at = x[f'wheels.{w}.z'] - x['ride.z'] - side * x['ride.phi'] + place * x['ride.theta']
        rate = x[f'wheels.{w}.vz'] - x['ride.vz'] - side * x['ride.p'] + place * x['ride.q']
        travels.append(at)
        z, vz, omega = (x[f'wheels.{w}.{name}'] for name in ('z', 'vz', 'omega'))
        E += axle.unsprung_mass_kg / 2 * vz**2 + wheel.spin_inertia_kgm2 / 2 * omega**2
        E += axle.ride_rate_npm / 2 * at**2 + wheel.vertical_stiffness_npm / 2 * z**2
        P -= axle.damper_rate_nspm * rate**2 + wheel.vertical_damping_nspm * vz**2
        # anti-roll is added below; the links make the contact patch follow the travel
        Vx = x['planar.vx'] - side * x['planar.r'] - body.cog_height_m * x['ride.q']
        Vx += axle.pitch_centre_height_m / place * rate
        Vy = x['planar.vy'] + place * x['planar.r'] + body.cog_height_m * x['ride.p']
        Vy += axle.roll_centre_height_m / side * rate
        along = Vx * np.cos(delta) + Vy * np.sin(delta)
        across = -Vx * np.sin(delta) + Vy * np.cos(delta)
        load = {name: readings[f'loads.{w}.{name}'] for name in ('torque', 'Fz', 'Fx', 'Fy')}
        P += load['Fx'] * (along - omega * wheel.radius_m) + load['Fy'] * across
        P += load['torque'] * omega
        P -= wheel.rolling_resistance * load['Fz'] * wheel.radius_m * abs(omega)
    for axle, left, right in ((front, 0, 1), (rear, 2, 3)):
        E += axle.antiroll_npm / 2 * (travels[left] - travels[right]) ** 2
    return E, P


def test_power_equals_the_change_of_energy(params, rng):
    """At random states: body, springs and wheels store exactly what flows in and is not lost."""
    derivative, _ = integrator.plant_functions()
    p = integrator.parameter_vector(params, 1.0)
    scale = dict.fromkeys(STATES, 0.0)
    scale |= {f'planar.{n}': s for n, s in zip(('vx', 'vy', 'r'), (3.0, 3.0, 0.5))}
    scale |= {f'ride.{n}': s for n, s in zip(('z', 'vz', 'phi', 'p'), (0.02, 0.2, 0.05, 0.3))}
    scale |= {'ride.theta': 0.03, 'ride.q': 0.2, 'servos.steer.position': 0.2}
    scale |= {'servos.front.position': 4e3, 'servos.rear.position': 4e3}
    for w in WHEELS:
        names = ('z', 'vz', 'omega', 'kappa', 'tan_alpha')
        for n, s in zip(names, (0.005, 0.2, 5.0, 0.1, 0.1)):
            scale[f'wheels.{w}.{n}'] = s
    at_rest = rolling_state(params, Start(0.0, 0.0, 0.4, 25.0))
    for _ in range(30):
        x = at_rest + np.array([scale[n] for n in STATES]) * rng.uniform(-1, 1, len(STATES))
        slope, readings = (np.array(v).ravel() for v in derivative(x, np.zeros(3), p))
        readings = dict(zip(READINGS, readings))
        h = 1e-6
        ends = [
            energy_and_power(dict(zip(STATES, x + s * h * slope)), readings, slope, params)[0]
            for s in (-1, 1)
        ]
        _, power = energy_and_power(dict(zip(STATES, x)), readings, slope, params)
        assert (ends[1] - ends[0]) / (2 * h) == pytest.approx(power, rel=1e-4, abs=30.0)


def test_straight_braking_equals_the_closed_form(params, drive):
    Fxf, Fxr = -4000.0, -2500.0
    track = drive(lambda t, car: (0.0, Fxf, Fxr), 3.0, 30.0)
    begin = 1000  # the servos have settled
    t = np.arange(len(track.rows) - begin) * 1e-3
    body, wheel = params.car.body, params.car.wheel
    mass = body.mass_kg + 4 * wheel.spin_inertia_kgm2 / wheel.radius_m**2
    drag = body.air_density_kgpm3 / 2 * body.drag_area_m2
    rolling = wheel.rolling_resistance * body.mass_kg * body.gravity_mps2
    braking = -Fxf - Fxr + rolling
    v_0 = track.column('planar.vx')[begin]
    turning = np.sqrt(drag * braking) / mass
    v = np.sqrt(braking / drag) * np.tan(np.arctan(v_0 * np.sqrt(drag / braking)) - turning * t)
    # the wheels slip by up to 2 %, and with them their share of the inertia
    error = track.column('planar.vx')[begin:] - v
    assert np.abs(error).max() < 2e-3 * (v_0 - v[-1])


@pytest.mark.parametrize('speed', [10.0, 20.0, 30.0])
def test_agrees_with_the_linear_single_track_below_a_fifth_of_g(params, drive, speed):
    body = params.car.body
    l_f, l_r = body.cog_to_front_m, body.cog_to_rear_m
    wheelbase = l_f + l_r
    weight = body.mass_kg * body.gravity_mps2
    scaling = params.car.scaling
    C = []
    for share, s in ((l_r, scaling.front), (l_f, scaling.rear)):
        c = tyre.Contact(weight * share / wheelbase / 2, 0, 0, 0, 1, params.car.wheel.pressure_pa)
        C.append(-2 * float(tyre.stiffness(c, params.tyre, s).Ky))
    understeer = body.mass_kg / wheelbase * (l_r / C[0] - l_f / C[1])
    assert understeer > 0
    ay = 0.1 * body.gravity_mps2
    delta = ay * (wheelbase / speed**2 + understeer)
    track = drive(lambda t, car: (delta, 0.0, 300.0), 3.0, speed)
    r = track.column('planar.r')[-1]
    v = track.column('planar.vx')[-1]
    # load transfer and the camber of a rolling body add a little understeer
    assert r / delta == pytest.approx(v / (wheelbase + understeer * v**2), rel=0.05)


def test_rows_report_the_derivative_of_the_motion(drive):
    track = drive(wild, 2.0, 20.0)
    vx, vy, r = (track.column(f'planar.{n}') for n in ('vx', 'vy', 'r'))
    ax = np.gradient(vx, 1e-3) - r * vy
    ay = np.gradient(vy, 1e-3) + r * vx
    for derived, name in ((ax, 'ax'), (ay, 'ay')):
        error = (derived - track.column(f'acceleration.{name}'))[1:-1]
        assert np.abs(error).max() < 0.2
        assert np.sqrt(np.mean(error**2)) < 0.01
