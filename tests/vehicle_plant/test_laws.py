"""Laws that every manoeuvre keeps: energy, symmetry, acceleration, convergence of the integrator.

The books of energy are kept here from textbook terms alone, and share no code with the equations.
"""

from typing import NamedTuple

import numpy as np
import pytest
from drives import advance_interpreted, ahead, altered, drive, perform
from scipy.integrate import cumulative_trapezoid

from msgs_yaml.types import WHEELS
from node_runtime import named_vector
from vehicle_plant import integrator, manoeuvres, road_friction
from vehicle_plant.actuators import DelayLine, SetPointRamp, delay_steps
from vehicle_plant.initial_state import Start, rolling_state
from vehicle_plant.manoeuvre import MANOEUVRES
from vehicle_plant.simulator import START_NS
from vehicle_plant.state import Outputs, SetPoints, State, Trajectory

DRIVEN = [name for name in MANOEUVRES if name != 'sine_sweep']  # which is long, and gentle
BALANCE = 1e-5  # of the energy exchanged; what is left is the quadrature over 1 ms rows


class Place(NamedTuple):
    """Where a wheel is."""

    axle: object  # car.Axle
    x: float  # m from the CoG, forward
    y: float  # m, left


def places(car):
    body, axles = car.body, car.suspension
    ends = {'f': (axles.front, body.cog_to_front_m), 'r': (axles.rear, -body.cog_to_rear_m)}
    sides = {'l': 1, 'r': -1}
    result = {}
    for w in WHEELS:
        axle, x = ends[w[0]]
        result[w] = Place(axle, x, sides[w[1]] * axle.track_m / 2)
    return result


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
    arms = (1, at.y, -at.x)
    pairs = (('z', ('z', 'phi', 'theta')), ('vz', ('vz', 'p', 'q')))
    return [
        track.column(f'wheels.{w}.{name}')
        - sum(arm * track.column(f'ride.{n}') for arm, n in zip(arms, names, strict=True))
        for name, names in pairs
    ]


def stored(track, car):
    """Return kinetic energy, that of springs and tyres, and that of the raised body [J]."""
    body, front, rear = car.body, car.suspension.front, car.suspension.rear
    sprung = body.mass_kg - 2 * (front.unsprung_mass_kg + rear.unsprung_mass_kg)
    wheelbase = body.cog_to_front_m + body.cog_to_rear_m

    def raised(centre, angle):
        height = getattr(front, centre) * body.cog_to_rear_m
        height += getattr(rear, centre) * body.cog_to_front_m
        arm = body.cog_height_m - height / wheelbase
        return -sprung * body.gravity_mps2 / 2 * arm * track.column(angle) ** 2

    moving = (
        ('planar.vx', body.mass_kg),
        ('planar.vy', body.mass_kg),
        ('planar.r', body.yaw_inertia_kgm2),
        ('ride.vz', sprung),
        ('ride.p', body.roll_inertia_kgm2),
        ('ride.q', body.pitch_inertia_kgm2),
    )
    E = sum(inertia / 2 * track.column(name) ** 2 for name, inertia in moving)
    E += raised('roll_centre_height_m', 'ride.phi') + raised('pitch_centre_height_m', 'ride.theta')
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
    angles, static, speed = steered(track, car), weights(car), np.hypot(vx, vy)
    P = {'drag': -body.air_density_kgpm3 / 2 * body.drag_area_m2 * speed**3}
    for part in ('tyres', 'brakes and drive', 'rolling resistance', 'dampers', 'lift'):
        P[part] = np.zeros_like(vx)
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
    t, E = manoeuvres.times(track), stored(track, car)
    work = {part: cumulative_trapezoid(P, t, initial=0) for part, P in powers(track, car).items()}
    error = E - E[0] - sum(work.values())
    exchanged = sum(np.abs(W).max() for W in work.values())
    return float(np.abs(error).max() / exchanged), work


@pytest.mark.parametrize('friction', [1.0, 0.2])
@pytest.mark.parametrize('name', DRIVEN)
def test_energy_balances_over_the_manoeuvre(name, friction):
    driven = perform(name, friction)
    assert driven.tracks
    for run, track in zip(driven.runs, driven.tracks):
        error, work = imbalance(track, driven.case.plant.car)
        assert error < BALANCE, (run.label, error)
        # drag, rolling resistance and dampers only take, and so do tyres in the long run
        for part in ('drag', 'rolling resistance', 'tyres'):
            assert work[part][-1] < 0, (run.label, part)


def test_energy_balances_in_a_car_with_lift_and_wheels_that_steer_by_themselves(params):
    steering = {'roll_steer': 0.05, 'compliance_steer_radpn': 3e-7}
    plant = altered(
        params,
        car__body__front_lift_area_m2=0.1,
        car__body__rear_lift_area_m2=0.3,
        **{f'car__suspension__{a}__{k}': v for a in ('front', 'rear') for k, v in steering.items()},
    )
    run = perform('sine_with_dwell').runs[-1]
    track = manoeuvres.drive(run, perform('sine_with_dwell').case._replace(plant=plant))
    assert imbalance(track, plant.car)[0] < BALANCE
    assert imbalance(track, params.car)[0] > 10 * BALANCE


COLUMNS = (*named_vector.names(State), *named_vector.names(Outputs))
SIDES = {'fl': 'fr', 'fr': 'fl', 'rl': 'rr', 'rr': 'rl'}
ODD = {'Y', 'psi', 'vy', 'r', 'phi', 'p', 'tan_alpha', 'ay', 'Fy'}  # change sign in a mirror
LARGE = {'Fz', 'Fx', 'Fy', 'torque', 'front', 'rear'}  # N, N m: thousands


def mirrored(track, column):
    """Return a column as it would be on the other side of a mirror along the road."""
    parts = column.split('.')
    odd = parts[-1] in ODD or parts[1] == 'steer'
    return (-1 if odd else 1) * track.column('.'.join(SIDES.get(part, part) for part in parts))


def assert_mirrored(left, right):
    for column in COLUMNS:
        scale = 1e4 if LARGE & set(column.split('.')) else 1.0
        difference = np.abs(left.column(column) - mirrored(right, column)).max()
        assert difference <= 1e-9 * scale, column


def wild(side):
    def law(t, car):
        Fxf, Fxr = -4000 * max(np.sin(2 * t), 0), -6000 * np.sin(1.3 * t)
        return side * 0.15 * np.sin(3 * t), Fxf, Fxr

    return law


def test_a_wild_drive_is_mirrored_and_its_accelerations_are_those_of_its_motion():
    left = drive(wild(1), 2.0)
    assert_mirrored(left, drive(wild(-1), 2.0))
    vx, vy, r = (left.column(f'planar.{n}') for n in ('vx', 'vy', 'r'))
    derived = np.gradient(vx, 1e-3) - r * vy, np.gradient(vy, 1e-3) + r * vx
    for expected, measured in zip(derived, left.imu_columns()[1:3]):
        error = (expected - measured)[1:-1]
        assert np.abs(error).max() < 0.2
        assert np.sqrt(np.mean(error**2)) < 0.01


def test_lifted_wheel_pushes_nothing():
    """On a road of twice the usual grip a swerve lifts the inner wheels."""
    track = drive(lambda t, car: (0.16 * np.sin(4 * t), 0.0, 0.0), 1.2, 25.0, friction=2.0)
    Fz, Fy = (np.array([track.column(f'loads.{w}.{n}') for w in WHEELS]) for n in ('Fz', 'Fy'))
    assert np.abs(track.column('ride.phi')).max() < 0.3
    assert Fz.min() == 0.0
    assert np.abs(Fy[Fz == 0.0]).max() < 5.0


N = len(named_vector.names(State))
REST = SetPoints(0.0, 0.0, 0.0)
ICE_LEFT = road_friction.patch_array([5, 0, 200, 0, 200, 10, 5, 10], [0.3])


@pytest.mark.needs('compiler')
@pytest.mark.parametrize('patches', [None, ICE_LEFT], ids=['dry', 'patch'])
def test_compiled_steps_are_the_interpreted_ones(params, rng, patches):
    p = integrator.parameter_vector(params, 0.8)
    x = rolling_state(params, Start(3.0, 0.5, 0.1, 22.0))
    given = x.copy()
    set_points = np.cumsum(rng.normal(size=(201, 3)) * [0.005, 300, 300], axis=0)
    state, fast = integrator.advance(x, set_points, p, patches=patches)
    _, slow = advance_interpreted(x, set_points, p, patches)
    assert np.abs(fast - slow).max() <= 1e-9 * np.abs(fast).max()
    assert np.array_equal(state, fast[-1, :N])
    assert np.array_equal(x, given)


def drive_in_steps(run, case, h):
    """Return what `manoeuvres.drive` does in steps of h [s], a row per millisecond or per step."""
    steps, stride = round(manoeuvres.TICK_S / h), max(round(integrator.STEP_S / h), 1)
    p = integrator.parameter_vector(case.plant, case.friction)
    x = rolling_state(case.plant, ahead(run.speed))
    delays = (round(n * integrator.STEP_S / h) for n in delay_steps(case.plant.car))
    line, ramp = DelayLine(SetPoints(*delays), REST), SetPointRamp(REST)
    vx, rows = run.speed, []
    for tick in range(1, round(run.seconds / manoeuvres.TICK_S) + 1):
        ramp.set_target(run.law(tick * manoeuvres.TICK_S, vx), steps)
        x, burst = integrator.advance(x, line.shift(ramp.advance(steps)), p, h)
        rows.append(burst[stride - 1 :: stride])
        vx = Trajectory(np.empty(0), rows[-1]).column('planar.vx')[-1]
    rows = np.concatenate(rows)
    every_ns = round(h * stride * 1e9)
    return Trajectory(START_NS + every_ns * np.arange(1, len(rows) + 1), rows)


@pytest.mark.parametrize('delay_ms', [0, 70])
def test_a_simulator_drives_in_steps_of_a_millisecond(params, delay_ms):
    driven = perform('turn_braking')
    case = driven.case._replace(plant=altered(params, car__steering__delay_ms=delay_ms))
    track = manoeuvres.drive(driven.runs[2], case)
    expected = drive_in_steps(driven.runs[2], case, integrator.STEP_S)
    assert track.rows.tobytes() == expected.rows.tobytes()
    assert track.stamp_ns.tolist() == expected.stamp_ns.tolist()


QUANTITIES = {
    'position': ('planar.X', 'planar.Y'),
    'yaw_rate': ('planar.r',),
    'acceleration': ('acceleration.ax', 'acceleration.ay'),
    'slip': tuple(f'wheels.{w}.{slip}' for w in WHEELS for slip in ('kappa', 'tan_alpha')),
}


def step_errors(name, *steps_s):
    """Return the greatest differences of a manoeuvre's first run to one in steps of 0.1 ms."""
    case, (run, *_) = perform(name)[:2]
    reference = drive_in_steps(run, case, integrator.STEP_S / 10)

    def difference(track, names):
        """Compare at the common instants; the reference has every millisecond."""
        rows = (track.stamp_ns - reference.stamp_ns[0]) // np.diff(reference.stamp_ns[:2])
        return max(np.abs(track.column(n) - reference.column(n)[rows]).max() for n in names)

    tracks = [drive_in_steps(run, case, h) for h in steps_s]
    return [{q: difference(track, n) for q, n in QUANTITIES.items()} for track in tracks]


@pytest.mark.parametrize('name', ['step_steer', 'turn_braking', 'sine_with_dwell'])
def test_in_a_manoeuvre_the_order_is_four_and_a_millisecond_leaves_little(name):
    coarse, fine = step_errors(name, 2 * integrator.STEP_S, integrator.STEP_S)
    for quantity in ('acceleration', 'slip'):
        assert np.log2(coarse[quantity] / fine[quantity]) > 3.5
    most = {'position': 1e-7, 'yaw_rate': 1e-8, 'acceleration': 1e-5, 'slip': 1e-7}
    assert all(fine[quantity] < value for quantity, value in most.items())


def test_standstill_is_of_first_order_and_still_accurate():
    (fine,) = step_errors('straight_braking', integrator.STEP_S)
    assert fine['position'] < 1e-5
    assert fine['acceleration'] < 1e-2
