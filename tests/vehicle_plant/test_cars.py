"""Every car of config/: its loads, balance and stability, and the figures it was made for."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from msgs_yaml.types import WHEELS, Command
from node_runtime import named_vector
from node_runtime import parameters as yaml_parameters
from vehicle_plant import circular_driving, double_track, identify, integrator, parameters, tyre
from vehicle_plant.circular_driving import CircleParams
from vehicle_plant.initial_state import Start
from vehicle_plant.simulator import Simulator
from vehicle_plant.state import State

CARS = ('bmw_545i.yaml', 'bmw_330i.yaml', 'vw_gti.yaml', 'bmw_320i.yaml')


@pytest.fixture(scope='module', params=CARS)
def name(request):
    return request.param


@pytest.fixture(scope='module')
def cars():
    return {name: parameters.load(parameters.config_file(name)) for name in CARS}


@pytest.fixture(scope='module')
def plant(cars, name):
    return cars[name]


@pytest.fixture(scope='module')
def circles(cars):
    manoeuvre = yaml_parameters.load(CircleParams, parameters.config_file('identify.yaml'))
    return {name: circular_driving.drive(car, 1.0, manoeuvre) for name, car in cars.items()}


def wheelbase(plant):
    return plant.car.body.cog_to_front_m + plant.car.body.cog_to_rear_m


def understeer_gradient(plant, track):
    """Return the steer beyond the geometric one over lateral acceleration, to 4 m/s^2 [deg/g]."""
    ay = track.column('acceleration.ay')
    curvature = track.column('planar.r') / track.column('planar.vx')
    excess = track.column('servos.steer.position') - wheelbase(plant) * curvature
    linear = (ay > 1.0) & (ay < 4.0)
    return np.degrees(9.81 * np.polyfit(ay[linear], excess[linear], 1)[0])


def test_all_car_files_are_here():
    folder = parameters.config_file(parameters.DEFAULT_CAR).parent
    fit = {p.name for p in folder.glob('*.yaml') if '\n    car:' in p.read_text()}
    assert fit == set(CARS)


def test_static_loads_are_those_of_the_lever_arms(plant):
    car = Simulator(plant, 1.0, Start(0.0, 0.0, 0.0, 0.0))
    track = car.advance(None, 3000)
    body = plant.car.body
    weight = body.mass_kg * body.gravity_mps2
    for axle, arm in (('f', body.cog_to_rear_m), ('r', body.cog_to_front_m)):
        left, right = (track.column(f'loads.{axle}{side}.Fz')[-1] for side in 'lr')
        assert left == pytest.approx(weight * arm / wheelbase(plant) / 2, rel=1e-4)
        assert left == pytest.approx(right, rel=1e-9)


UNDERSTEERING = tuple(name for name in CARS if name != 'bmw_320i.yaml')


@pytest.mark.parametrize('name', UNDERSTEERING, scope='module')
def test_car_understeers(plant, circles, name):
    track = circles[name]
    assert 0.5 < understeer_gradient(plant, track) < 4.0
    front, rear = circular_driving.axle_points(track, plant)
    assert abs(front.alpha[-1]) > 2 * abs(rear.alpha[-1])


def test_the_car_of_the_multi_body_model_is_neutral(cars, circles):
    """The single track of its lengths and tyres has no understeer gradient at all."""
    name = 'bmw_320i.yaml'
    assert abs(understeer_gradient(cars[name], circles[name])) < 0.3


def test_straight_running_is_stable_at_every_speed(plant):
    """Eigenvalues of the linearised car: nothing grows; yaw and side slip decay within seconds."""
    states = named_vector.names(State)
    derivative, _ = integrator.plant_functions()
    x, u, p = (ca.SX.sym(n, derivative.size1_in(i)) for i, n in enumerate('xup'))
    slope = ca.Function('A', [x, u, p], [ca.jacobian(derivative(x, u, p)[0], x)])
    # position, heading and the slipped brake lining have no restoring force
    free = ('planar.X', 'planar.Y', 'planar.psi', *(f'wheels.{w}.windup' for w in WHEELS))
    kept = [i for i, n in enumerate(states) if n not in free]
    numbers = integrator.parameter_vector(plant, 1.0)
    for speed in (10.0, 25.0, 40.0, 55.0):
        car = Simulator(plant, 1.0, Start(0.0, 0.0, 0.0, speed))
        row = car.advance(None, 1000).rows[-1, : len(states)]
        A = np.array(slope(row, np.zeros(3), numbers))[np.ix_(kept, kept)]
        growth = np.linalg.eigvals(A).real
        assert growth.max() < 1e-6, speed


def test_step_of_steer_settles(plant):
    """0.4 g at 30 m/s: the yaw rate reaches its end without a swing beyond a quarter of it."""
    speed = 30.0
    gradient = 0.03 / 9.81
    delta = 0.4 * 9.81 * (wheelbase(plant) / speed**2 + gradient)
    car = Simulator(plant, 1.0, Start(0.0, 0.0, 0.0, speed))
    r = []
    for _ in range(80):
        force = 4000.0 * (speed - car.state.vx)
        rear = circular_driving.rear_drive_share(plant)
        command = Command(car.stamp_ns, delta, 0.0, force * (1 - rear), force * rear)
        r.append(car.advance(command, 50).column('planar.r'))
    r = np.concatenate(r)
    end = r[-1]
    assert end > 0.05
    assert np.abs(r[2000:] / end - 1).max() < 0.02
    assert r.max() < 1.35 * end


def test_e90_rolls_as_measured(cars, circles):
    """2.0 deg at 0.6 g (SAE 2007-01-0817)."""
    track = circles['bmw_330i.yaml']
    ay, phi = track.column('acceleration.ay'), track.column('ride.phi')
    rising = slice(0, int(ay.argmax()))
    assert np.degrees(np.interp(0.6 * 9.81, ay[rising], phi[rising])) == pytest.approx(2.0, abs=0.1)


def test_gti_rolls_as_published(cars, circles):
    """0.0078 rad per m/s^2 (Stanford Dynamic Design Lab)."""
    track = circles['vw_gti.yaml']
    ay, phi = track.column('acceleration.ay'), track.column('ride.phi')
    linear = ay < 5.0
    assert np.polyfit(ay[linear], phi[linear], 1)[0] == pytest.approx(0.0078, rel=0.06)


@pytest.mark.parametrize(
    ('axle', 'cornering', 'friction'), [(0, 120e3, 0.85), (1, 200e3, 0.90)], ids=['front', 'rear']
)
def test_gti_has_the_published_axles(cars, circles, axle, cornering, friction):
    fit = identify.fit_fiala(
        circular_driving.axle_points(circles['vw_gti.yaml'], cars['vw_gti.yaml'])[axle]
    )
    assert fit.cornering == pytest.approx(cornering, rel=0.03)
    assert fit.friction == pytest.approx(friction, rel=0.03)


def test_e90_tyres_have_the_measured_stiffness(cars):
    """Per tyre at the static load: 116.6 and 109.5 kN/rad between the tabulated loads."""
    plant = cars['bmw_330i.yaml']
    for corner, scaling, expected in zip(
        double_track.wheel_corners(plant.car)[::2],
        (plant.car.scaling.front, plant.car.scaling.rear),
        (116.6e3, 109.5e3),
    ):
        c = tyre.Contact(float(corner.Fz_static), 0.0, 0.0, 0.0, 1.0, 220e3)
        assert -tyre.stiffness(c, plant.tyre, scaling).Ky == pytest.approx(expected, rel=0.02)


def test_car_without_an_engine_cannot_hold_its_speed(cars):
    force = cars['vw_gti.yaml'].car.force
    off = replace(force, front=replace(force.front, drive_n=0.0))
    plant = replace(cars['vw_gti.yaml'], car=replace(cars['vw_gti.yaml'].car, force=off))
    with pytest.raises(circular_driving.CircleError, match='no engine'):
        circular_driving.rear_drive_share(plant)
