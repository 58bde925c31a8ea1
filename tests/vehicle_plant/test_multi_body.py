"""The multi-body plant: the equations of its package, our signs, actuators, friction and limits."""

import sys

import casadi as ca
import numpy as np
import pytest
from drives import advance_interpreted, altered, drive, load

from msgs_yaml.types import WHEELS
from node_runtime import named_vector
from node_runtime.parameters import ParameterError
from vehicle_plant import integrator, parameters, road_friction
from vehicle_plant.initial_state import Start
from vehicle_plant.simulator import Simulator

pytest.importorskip('vehiclemodels')
from vehiclemodels.init_mb import init_mb
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

from vehicle_plant.multi_body import equations, symbolic
from vehicle_plant.multi_body.equations import MULTI_BODY, Body

SPEED = 20.0
P = equations.vehicle()
GRAVITY = 9.81
MASS_WITH_WHEELS = P.m + 4 * P.I_y_w / P.R_w**2


@pytest.fixture(scope='module')
def plant():
    return load(parameters.MULTI_BODY_CAR)


@pytest.fixture(scope='module')
def dynamics():
    """The derivative of the 29 states, from states and inputs of the package."""
    flat = [ca.SX.sym('x', 29), ca.SX.sym('u', 2)]
    body = named_vector.build(Body, ca.vertsplit(flat[0]))
    dot, _ = equations.evaluate_model(body, flat[1][0], flat[1][1], [(1.0, 1.0)] * 4)
    return ca.Function('f', flat, [ca.vertcat(*named_vector.leaves(dot))])


def mu_g(plant):
    """Return what the tyres of a car on a dry road hold [m/s^2]."""
    return plant.car.scaling.front.LMUY * P.tire.p_dy1 * GRAVITY


def held(*target):
    return lambda t, car: target


def random_states(count):
    """Yield states of the package within its domain, fast and slow, with inputs."""
    rng = np.random.default_rng(7)
    scale = np.repeat([0.0, 0.02, 5.0, 0.01], [6, 17, 4, 2])
    for i in range(count):
        speed = rng.uniform(3.0, 55.0) if i % 5 else rng.uniform(0.0, 0.09)
        steer, yaw, beta = rng.uniform(-1, 1, 3) * [0.4 if i % 3 else 1.2, 0.5, 0.3]
        x = np.array(init_mb([*rng.uniform(-50, 50, 2), steer, speed, 1.0, yaw, beta], P))
        yield x + scale * rng.normal(size=x.size), rng.uniform(-1, 1, 2) * [0.6, 13.0]


def test_generated_equations_are_those_of_the_package(dynamics):
    for x, u in random_states(200):
        expected = np.array(vehicle_dynamics_mb(x.tolist(), u.tolist(), P))
        assert np.isfinite(expected).all()
        actual = np.asarray(dynamics(x, u)).ravel()
        np.testing.assert_allclose(actual, expected, rtol=1e-10, atol=1e-10)


def test_compiled_steps_are_the_interpreted_ones(plant):
    p = integrator.parameter_vector(plant, 0.9)
    x = MULTI_BODY.start(plant, Start(1.0, 2.0, 0.3, SPEED))
    set_points = np.linspace([0.0, 0.0, 0.0], [0.05, -2000.0, -1000.0], 21)
    patches = road_friction.patch_array([0, -50, 50, -50, 50, 50, 0, 50], [0.6])
    state, rows = integrator.advance(x, set_points, p, patches=patches, model=MULTI_BODY)
    again, slow = advance_interpreted(x, set_points, p, patches, MULTI_BODY)
    np.testing.assert_allclose(rows, slow, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(state, again, rtol=1e-9, atol=1e-9)


def test_steering_to_the_left_is_a_left_turn(plant):
    column = drive(held(0.03, 0.0, 0.0), 1.5, plant=plant).column
    for name in ('planar.Y', 'planar.psi', 'planar.r', 'acceleration.ay'):
        assert column(name)[-1] > 0.05, name
    # the body leans out of the curve: its left side rises, the right wheels are loaded
    assert column('ride.phi')[-1] > 0.01
    for left, right in (('fl', 'fr'), ('rl', 'rr')):
        assert column(f'loads.{right}.Fz')[-1] > 1.2 * column(f'loads.{left}.Fz')[-1]
        # the outer wheel is the faster one; the slip is to the right, the force to the left
        assert column(f'wheels.{right}.omega')[-1] > column(f'wheels.{left}.omega')[-1]
        assert column(f'loads.{right}.Fy')[-1] > 500
        assert column(f'wheels.{right}.tan_alpha')[-1] < -0.005
        # a loaded tyre is compressed: its wheel is lower
        assert column(f'wheels.{right}.z')[-1] < -1e-3 < 1e-3 < column(f'wheels.{left}.z')[-1]
    lateral = sum(column(f'loads.{w}.Fy')[-1] for w in WHEELS)
    assert column('acceleration.ay')[-1] == pytest.approx(lateral / P.m, rel=0.03)
    assert column('servos.steer.position')[-1] == pytest.approx(0.03, abs=1e-6)


@pytest.mark.parametrize(('total', 'front'), [(-3600.0, 0.66), (2000.0, 0.0)])
def test_the_split_of_brakes_and_drive_is_that_of_the_model(plant, total, front):
    """Whatever split was commanded; the sum is kept, and the actuators report what acts."""
    track = drive(held(0.0, 0.0, total), 1.5, plant=plant)
    forces = [track.column(f'servos.{axle}.position')[-1] for axle in ('front', 'rear')]
    assert forces == pytest.approx([front * total, (1 - front) * total], abs=1.0)
    torque = track.column('loads.fr.torque')[-1]
    assert torque == pytest.approx(front * total * P.R_w / 2, abs=1.0)
    expected = total / MASS_WITH_WHEELS
    assert track.column('acceleration.ax')[-1] == pytest.approx(expected, rel=0.02)
    # braking lowers the nose, loads the front axle, and its slip is negative
    assert -total * track.column('ride.theta')[-1] > 0
    assert -total * (track.column('loads.fl.Fz')[-1] - track.column('loads.fl.Fz')[0]) > 0
    assert total * track.column('wheels.rl.kappa')[-1] > 0


@pytest.mark.parametrize('friction', [0.5, 1.0])
def test_grip_grows_with_the_friction_of_the_road(plant, friction):
    """And with the camber of a body that rolls."""
    track = drive(held(0.1, 0.0, 0.0), 1.0, plant=plant, friction=friction)
    peak = track.column('acceleration.ay').max()
    assert 0.9 < peak / (friction * mu_g(plant)) < 1.12


def test_every_wheel_has_the_friction_under_it(plant):
    """Locked brakes, ice under the left wheels: they push less, and the car turns right."""
    ice = road_friction.patch_array([0, 0, 300, 0, 300, 30, 0, 30], [0.3])
    track = drive(held(0.0, -3300.0, -1700.0), 0.5, plant=plant, patches=ice)
    left, right = (abs(track.column(f'loads.f{side}.Fx')[-1]) for side in 'lr')
    assert left < 0.5 * right
    assert track.column('planar.r')[-1] < -0.05


def test_brakes_stop_the_car_and_hold_it(plant):
    track = drive(held(0.05, -3000.0, -1500.0), 5.0, 10.0, plant)
    X = track.column('planar.X')
    assert np.isfinite(track.rows).all()
    assert (np.diff(X) >= -1e-6).all()
    assert track.column('planar.vx')[-1] == 0.0
    assert X[-1] == X[-500]
    # v^2 / 2a, and the servo that lags by 72 ms
    expected = 10.0**2 / 2 / (4500 / MASS_WITH_WHEELS) + 10.0 * 0.072
    assert X[-1] == pytest.approx(expected, rel=0.03)


def test_a_standing_car_pulls_away(plant):
    track = drive(held(0.0, 0.0, 2000.0), 4.0, 0.0, plant)
    assert np.isfinite(track.rows).all()
    assert 4.0 < track.column('planar.vx')[-1] < 2000 / P.m * 4.0


def test_a_car_that_leaves_the_domain_slides_to_rest(plant):
    """Across the road the slips of the model divide by zero: Coulomb friction from there."""
    sideways = Start(0.0, 0.0, 0.0, 0.0, vy=15.0)
    track = drive(held(0.2, -3000.0, -2000.0), 4.0, sideways, plant)
    assert np.isfinite(track.rows).all()
    speed = np.hypot(track.column('planar.vx'), track.column('planar.vy'))
    assert (speed[500] - speed[100]) / 0.4 == pytest.approx(-mu_g(plant), rel=0.03)
    assert speed[-1] < 0.05
    assert track.column('planar.Y')[-1] == pytest.approx(15.0**2 / 2 / mu_g(plant), rel=0.1)


def test_spinning_cars_stay_finite(plant):
    rng = np.random.default_rng(3)
    for _ in range(5):
        steer, brake = rng.uniform(-0.48, 0.48), rng.uniform(0.0, 6000.0)
        slide = Start(0.0, 0.0, 0.0, rng.uniform(5, 40), rng.uniform(-10, 10), rng.uniform(-2, 2))
        track = drive(held(steer, -brake, -brake / 2), 3.0, slide, plant)
        assert np.isfinite(track.rows).all()


@pytest.mark.parametrize('car', [parameters.MULTI_BODY_CAR, 'bmw_320i.yaml'])
def test_on_the_surface_of_its_tyre_test_the_car_rolls_over(car):
    """So does the double track of the same car; both slide with the friction of the car file."""
    ones = {f'car__scaling__{a}__LMU{x}': 1.0 for a in ('front', 'rear') for x in 'XY'}
    for plant, low, high in ((load(car), 0.0, 0.2), (altered(load(car), **ones), 0.3, np.inf)):
        assert low < drive(held(0.1, 0.0, 0.0), 2.0, plant=plant).column('ride.phi').max() < high


def test_the_start_has_pose_slide_and_weight(plant):
    car = Simulator(plant, 1.0, Start(1.0, 2.0, 0.5, 15.0, vy=1.0, r=0.2))
    assert car.state[1:] == pytest.approx((1.0, 2.0, 0.5, 15.0, 1.0, 0.2))
    loads = [float(car.now.column(f'loads.{w}.Fz')[0]) for w in WHEELS]
    assert sum(loads) == pytest.approx(P.m * GRAVITY, rel=1e-6)
    other = car.fork()
    assert np.array_equal(other.advance(None, 70).rows, car.advance(None, 70).rows)


def test_the_double_track_of_the_same_car_has_its_numbers(plant):
    car, tyre = plant.car, plant.tyre
    front, rear, body = car.suspension.front, car.suspension.rear, car.body
    outline, wheel = car.outline, car.wheel
    for ours, theirs in (
        (body.mass_kg, P.m),
        (body.yaw_inertia_kgm2, P.I_z),
        (body.roll_inertia_kgm2, P.I_Phi_s),
        (body.pitch_inertia_kgm2, P.I_y_s),
        (body.cog_to_front_m, P.a),
        (body.cog_to_rear_m, P.b),
        (body.cog_height_m, P.h_cg),
        (front.track_m, P.T_f),
        (rear.track_m, P.T_r),
        (front.ride_rate_npm, P.K_sf),
        (rear.ride_rate_npm, P.K_sr),
        (front.antiroll_npm, -P.K_tsf / P.T_f**2),
        (rear.antiroll_npm, -P.K_tsr / P.T_r**2),
        (front.camber_per_roll, 1 + P.D_f * P.T_f / 2),
        (rear.camber_per_roll, 1 + P.D_r * P.T_r / 2),
        (2 * front.unsprung_mass_kg, P.m_uf),
        (wheel.radius_m, P.R_w),
        (wheel.spin_inertia_kgm2, P.I_y_w),
        (wheel.vertical_stiffness_npm, P.K_zt),
        (tyre.longitudinal.PDX1, P.tire.p_dx1),
        (tyre.longitudinal.PKX1, P.tire.p_kx1),
        (tyre.lateral.PDY1, P.tire.p_dy1),
        # the slope of PKY1 FNOMIN sin(2 atan(Fz / (PKY2 FNOMIN)))
        (2 * tyre.lateral.PKY1 / tyre.lateral.PKY2, P.tire.p_ky1),
        (outline.width_m, P.w),
    ):
        assert ours == pytest.approx(theirs, rel=1e-6)
    wheelbase = body.cog_to_front_m + body.cog_to_rear_m
    length = wheelbase + outline.front_overhang_m + outline.rear_overhang_m
    assert length == pytest.approx(P.l, abs=1e-4)


def car_with(folder, name, value):
    """Return a file of the car in which one parameter differs."""
    path = folder / 'car.yaml'
    base = parameters.config_file(parameters.MULTI_BODY_CAR)
    path.write_text(f'/**:\n  ros__parameters:\n    base: {base}\n    {name}: {value}\n')
    return path


@pytest.mark.parametrize(
    ('name', 'value', 'text'),
    [
        ('car.body.mass_kg', 1500.0, r'car.body.mass_kg: is 1500.0; .* allowed 1093.295'),
        ('car.scaling.rear.LKY', 1.3, r'car.scaling.rear.LKY: .* allowed 1.0'),
        ('car.steering.rate_radps', 0.8, r'car.steering.rate_radps: is 0.8; .* at most 0.4'),
        ('car.steering.limit_rad', 1.1, r'car.steering.limit_rad: is 1.1; .* at most 1.066'),
        ('tyre_set', 'tyre_book.yaml', r"tyre_set: .* allowed 'tyre_320i.yaml'"),
        ('model', 'carsim', r"model: is 'carsim'; allowed"),
    ],
)
def test_what_would_have_no_effect_is_refused(tmp_path, name, value, text):
    with pytest.raises(ParameterError, match=text):
        parameters.load(car_with(tmp_path, name, value))


def test_without_the_package_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, 'vehiclemodels', None)
    with pytest.raises(ParameterError, match=r"model: .*pip install 'vehicle_plant\[commonroad\]'"):
        parameters.load(parameters.config_file(parameters.MULTI_BODY_CAR))
    # the same car as a double track does not need it
    assert parameters.load(parameters.config_file('bmw_320i.yaml')).car.body.mass_kg > 1000


def test_a_function_that_may_return_nothing_has_no_meaning_for_symbols():
    def may_return_nothing(x):  # noqa: RET503
        if x > 0:
            return 1

    with pytest.raises(ValueError, match='one branch returns, the other one does not'):
        symbolic.evaluate(may_return_nothing, (ca.SX.sym('x'),), ())
