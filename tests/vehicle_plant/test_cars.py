"""Every car of config/: its loads, balance and stability, and the figures it was made for."""

import re

import casadi as ca
import numpy as np
import pytest
from drives import ahead, circle, load
from installation import ROOT

from msgs_yaml import share
from msgs_yaml.types import WHEELS
from node_runtime import named_vector
from node_runtime import parameters as yaml_parameters
from vehicle_plant import circular_driving, identify, integrator, parameters, suspension, tyre
from vehicle_plant.initial_state import Start, rolling_state
from vehicle_plant.simulator import Simulator
from vehicle_plant.state import State

CARS = ('bmw_545i.yaml', 'bmw_330i.yaml', 'vw_gti.yaml', 'volvo_v40.yaml', 'bmw_320i.yaml')


@pytest.fixture(params=CARS)
def plant(request):
    return load(request.param)


def test_all_car_files_are_here():
    folder = parameters.config_file(parameters.DEFAULT_CAR).parent
    fit = {p.name for p in folder.glob('*.yaml') if '\n    car:' in p.read_text()}
    assert fit == set(CARS)


def test_a_standing_car_stays_and_carries_its_weight_by_the_lever_arms(plant):
    car = Simulator(plant, 1.0, Start(1.0, 2.0, 0.3, 0.0))
    track, body = car.advance(None, 3000), plant.car.body
    weight = body.mass_kg * body.gravity_mps2
    wheelbase = body.cog_to_front_m + body.cog_to_rear_m
    for axle, arm in (('f', body.cog_to_rear_m), ('r', body.cog_to_front_m)):
        left, right = (track.column(f'loads.{axle}{side}.Fz')[-1] for side in 'lr')
        assert left == pytest.approx(weight * arm / wheelbase / 2, rel=1e-4)
        assert left == pytest.approx(right, rel=1e-9)
    # static camber settles against the links: some tens of micrometres
    assert pytest.approx((1.0, 2.0), abs=1e-4) == (car.state.X, car.state.Y)
    assert abs(car.state.vx) < 1e-3


def test_wheels_of_a_sliding_start_roll_and_slip_as_their_contact_patches_move(plant):
    """The velocity of a point of a rigid body: v + r x position."""
    vx, vy, r = 20.0, -6.0, 0.8
    given = rolling_state(plant, Start(1.0, 2.0, 0.3, vx, vy, r))
    x, body, axles = (
        dict(zip(named_vector.names(State), given)),
        plant.car.body,
        plant.car.suspension,
    )
    assert given[:6].tolist() == [1.0, 2.0, 0.3, vx, vy, r]
    ends = {'f': (body.cog_to_front_m, axles.front), 'r': (-body.cog_to_rear_m, axles.rear)}
    for w in WHEELS:
        x_w, axle = ends[w[0]]
        rolling = vx - {'l': 1, 'r': -1}[w[1]] * axle.track_m / 2 * r
        assert x[f'wheels.{w}.omega'] * plant.car.wheel.radius_m == pytest.approx(rolling)
        assert x[f'wheels.{w}.tan_alpha'] == pytest.approx((vy + x_w * r) / rolling)


def linearised(plant, speeds, settle_ms):
    """Yield the derivative of the slopes by the state, at straight running, for each speed."""
    derivative, _ = integrator.plant_functions()
    x, u, p = (ca.SX.sym(n, derivative.size1_in(i)) for i, n in enumerate('xup'))
    slope = ca.Function('A', [x, u, p], [ca.jacobian(derivative(x, u, p)[0], x)])
    for speed in speeds:
        row = Simulator(plant, 1.0, ahead(speed)).advance(None, settle_ms).rows[-1, : x.size1()]
        yield np.array(slope(row, np.zeros(3), integrator.parameter_vector(plant, 1.0)))


def test_straight_running_is_stable_at_every_speed(plant):
    """Eigenvalues of the linearised car: nothing grows; yaw and side slip decay within seconds."""
    # position, heading and the slipped brake lining have no restoring force
    free = ('planar.X', 'planar.Y', 'planar.psi', *(f'wheels.{w}.windup' for w in WHEELS))
    kept = [i for i, n in enumerate(named_vector.names(State)) if n not in free]
    for A in linearised(plant, (10.0, 25.0, 40.0, 55.0), 1000):
        assert np.linalg.eigvals(A[np.ix_(kept, kept)]).real.max() < 1e-6


def test_fastest_mode_is_the_one_that_the_manual_names(params):
    manual = (ROOT / 'docs/plant.md').read_text()
    fastest = float(re.search(r'carcass, (\d+) 1/s', manual)[1])
    for A in linearised(params, (0.5, 5.0, 50.0), 100):
        assert np.abs(np.linalg.eigvals(A)).max() == pytest.approx(fastest, rel=0.02)


@pytest.mark.parametrize(
    ('name', 'low', 'high'),
    [
        ('bmw_545i.yaml', 0.5, 3.0),
        ('bmw_330i.yaml', 0.5, 4.0),
        ('vw_gti.yaml', 0.5, 4.0),
        # the single track of its lengths and tyres has no understeer gradient at all
        ('bmw_320i.yaml', -0.3, 0.3),
    ],
)
def test_car_understeers(name, low, high):
    """Steer beyond the geometric one over lateral acceleration, to 4 m/s^2 [deg/g]."""
    track, body = circle(name), load(name).car.body
    ay = track.column('acceleration.ay')
    curvature = track.column('planar.r') / track.column('planar.vx')
    excess = track.column('servos.steer.position')
    excess = excess - (body.cog_to_front_m + body.cog_to_rear_m) * curvature
    linear = (ay > 1.0) & (ay < 4.0)
    assert low < np.degrees(9.81 * np.polyfit(ay[linear], excess[linear], 1)[0]) < high
    front, rear = circular_driving.axle_points(track, load(name))
    assert low < 0.0 or abs(front.alpha[-1]) > 2 * abs(rear.alpha[-1])


def roll(name):
    """Return lateral acceleration and roll until the car slides."""
    track = circle(name)
    rising = slice(0, int(track.column('acceleration.ay').argmax()))
    return track.column('acceleration.ay')[rising], track.column('ride.phi')[rising]


def test_e90_is_the_measured_one():
    """2.0 deg at 0.6 g (SAE 2007-01-0817); tyres at the static load, between tabulated ones."""
    ay, phi = roll('bmw_330i.yaml')
    assert np.degrees(np.interp(0.6 * 9.81, ay, phi)) == pytest.approx(2.0, abs=0.1)
    plant = load('bmw_330i.yaml')
    corners, scaling = suspension.wheel_corners(plant.car)[::2], plant.car.scaling
    for corner, axle, expected in zip(corners, (scaling.front, scaling.rear), (116.6e3, 109.5e3)):
        c = tyre.Contact(float(corner.Fz_static), 0.0, 0.0, 0.0, 1.0, 220e3)
        assert -tyre.stiffness(c, plant.tyre, axle).Ky == pytest.approx(expected, rel=0.02)


def test_gti_is_the_published_one():
    """Stanford Dynamic Design Lab: 0.0078 rad of roll per m/s^2; stiffness and friction."""
    ay, phi = roll('vw_gti.yaml')
    assert np.polyfit(ay[ay < 5.0], phi[ay < 5.0], 1)[0] == pytest.approx(0.0078, rel=0.06)
    points = circular_driving.axle_points(circle('vw_gti.yaml'), load('vw_gti.yaml'))
    for axle, published in zip(points, ((120e3, 0.85), (200e3, 0.90))):
        fit = identify.fit_fiala(axle)
        assert (fit.cornering, fit.friction) == pytest.approx(published, rel=0.03)


def test_v40_has_the_axles_that_were_measured():
    used = yaml_parameters.read_file(
        share.path('mpcc_controller', 'config', 'car_volvo_v40.yaml')
    ).values
    points = circular_driving.axle_points(circle('volvo_v40.yaml'), load('volvo_v40.yaml'))
    for axle, name in zip(points, ('front', 'rear')):
        fit = identify.fit_fiala(axle)
        measured = used[f'tyre.{name}_cornering_npr'], used[f'tyre.{name}_friction']
        assert (fit.cornering, fit.friction) == pytest.approx(measured, rel=0.01)
