"""The multi-body plant: the equations of its package, our signs, actuators, friction and limits."""

import sys
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from msgs_yaml.types import WHEELS, Command
from node_runtime import named_vector
from node_runtime.parameters import ParameterError
from vehicle_plant import integrator, parameters, road_friction
from vehicle_plant.initial_state import Start
from vehicle_plant.simulator import TICK_STEPS, Simulator
from vehicle_plant.state import join_trajectories

pytest.importorskip('vehiclemodels')
from vehiclemodels.init_mb import init_mb
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

from vehicle_plant.multi_body import equations
from vehicle_plant.multi_body.equations import MULTI_BODY, Body

SPEED = 20.0


@pytest.fixture(scope='module')
def plant():
    return parameters.load(parameters.config_file(parameters.MULTI_BODY_CAR))


def drive(plant, law, seconds, speed=SPEED, friction=1.0, start=None, patches=None):
    """Drive law(t) -> (delta, Fxf, Fxr); the gate lets everything through."""
    gate = replace(plant.car.gate, friction_use=10.0, steer_rate_radps=100.0)
    plant = replace(plant, car=replace(plant.car, gate=gate))
    car = Simulator(plant, friction, start or Start(0.0, 0.0, 0.0, speed), patches=patches)
    pieces = []
    for tick in range(round(seconds * 20)):
        delta, front, rear = law(tick / 20)
        pieces.append(car.advance(Command(car.stamp_ns, delta, 0.0, front, rear), TICK_STEPS))
    assert car.gate.rejected == 0, car.gate.last_reason
    return join_trajectories(pieces)


def random_states(count):
    """Yield states of the package within its domain, fast and slow, with inputs."""
    rng = np.random.default_rng(7)
    p = equations.vehicle()
    scale = np.repeat([0.0, 0.02, 5.0, 0.01], [6, 17, 4, 2])
    for i in range(count):
        slow = i % 5 == 0
        speed = rng.uniform(0.0, 0.09) if slow else rng.uniform(3.0, 45.0)
        steer, yaw, beta = rng.uniform(-1, 1, 3) * [0.4, 0.5, 0.3]
        x = np.array(init_mb([*rng.uniform(-50, 50, 2), steer, speed, 1.0, yaw, beta], p))
        yield x + scale * rng.normal(size=x.size), rng.uniform(-1, 1, 2) * [0.6, 13.0]


def test_generated_equations_are_those_of_the_package():
    flat = [ca.SX.sym('x', 29), ca.SX.sym('u', 2)]
    body = named_vector.build(Body, ca.vertsplit(flat[0]))
    dot, _ = equations.evaluate_model(body, flat[1][0], flat[1][1])
    generated = ca.Function('f', flat, [ca.vertcat(*named_vector.leaves(dot))])
    for x, u in random_states(300):
        expected = np.array(vehicle_dynamics_mb(x.tolist(), u.tolist(), equations.vehicle()))
        actual = np.asarray(generated(x, u)).ravel()
        assert np.isfinite(expected).all()
        np.testing.assert_allclose(actual, expected, rtol=1e-10, atol=1e-10)


def test_steps_of_a_millisecond_follow_another_integrator(plant):
    """A swerve with braking: scipy's DOP853 on the Python function of the package."""
    p, seconds = equations.vehicle(), 0.5

    def steer_rate(t):
        return 0.3 * np.sin(2 * np.pi * t / seconds)

    acceleration = -3.0
    start = init_mb([0.0, 0.0, 0.0, SPEED, 0.0, 0.0, 0.0], p)
    reference = solve_ivp(
        lambda t, x: vehicle_dynamics_mb(list(x), [steer_rate(t), acceleration], p),
        (0.0, seconds),
        start,
        method='DOP853',
        rtol=1e-9,
        atol=1e-9,
        max_step=2e-3,
    ).y[:, -1]

    flat = [ca.SX.sym('x', 29), ca.SX.sym('u', 2)]
    body = named_vector.build(Body, ca.vertsplit(flat[0]))
    dot, _ = equations.evaluate_model(body, flat[1][0], flat[1][1])
    f = ca.Function('f', flat, [ca.vertcat(*named_vector.leaves(dot))])
    x, h = ca.DM(start), integrator.STEP_S
    for n in range(round(seconds / h)):
        u0, u1, u2 = ([steer_rate((n + part) * h), acceleration] for part in (0, 0.5, 1))
        k1 = f(x, u0)
        k2 = f(x + h / 2 * k1, u1)
        k3 = f(x + h / 2 * k2, u1)
        x += h / 6 * (k1 + 2 * k2 + 2 * k3 + f(x + h * k3, u2))
    # the lateral force jumps where the camber changes its sign: the order is one there
    np.testing.assert_allclose(np.asarray(x).ravel()[:6], reference[:6], rtol=0, atol=2e-4)


def test_compiled_steps_are_the_interpreted_ones(plant, advance_interpreted):
    p = integrator.parameter_vector(plant, 0.9)
    x = MULTI_BODY.start(plant, Start(1.0, 2.0, 0.3, SPEED))
    set_points = np.linspace([0.0, 0.0, 0.0], [0.05, -2000.0, -1000.0], 21)
    patches = road_friction.patch_array([0, -50, 50, -50, 50, 50, 0, 50], [0.6])
    state, rows = integrator.advance(x, set_points, p, patches=patches, model=MULTI_BODY)
    again, slow = advance_interpreted(x, set_points, p, patches, MULTI_BODY)
    np.testing.assert_allclose(rows, slow, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(state, again, rtol=1e-9, atol=1e-9)


def test_steering_to_the_left_is_a_left_turn(plant):
    track = drive(plant, lambda t: (0.03, 0.0, 0.0), 1.5)
    for name in ('planar.Y', 'planar.psi', 'planar.r', 'acceleration.ay'):
        assert track.column(name)[-1] > 0.05, name
    # the body leans out of the curve: its left side rises, the right wheels are loaded
    assert track.column('ride.phi')[-1] > 0.01
    for left, right in (('fl', 'fr'), ('rl', 'rr')):
        loads = [track.column(f'loads.{w}.Fz')[-1] for w in (left, right)]
        assert loads[1] > 1.2 * loads[0]
        # the outer wheel is the faster one; the slip is to the right, the force to the left
        assert track.column(f'wheels.{right}.omega')[-1] > track.column(f'wheels.{left}.omega')[-1]
        assert track.column(f'loads.{right}.Fy')[-1] > 500
        assert track.column(f'wheels.{right}.tan_alpha')[-1] < -0.005
    lateral = sum(track.column(f'loads.{w}.Fy')[-1] for w in WHEELS)
    mass = equations.vehicle().m
    assert track.column('acceleration.ay')[-1] == pytest.approx(lateral / mass, rel=0.03)
    assert track.column('servos.steer.position')[-1] == pytest.approx(0.03, abs=1e-6)


def with_wheels(p):
    """Return the mass [kg] of the car with the inertia of its four wheels."""
    return p.m + 4 * p.I_y_w / p.R_w**2


def test_braking_lowers_the_nose(plant):
    track = drive(plant, lambda t: (0.0, -2400.0, -1200.0), 1.0)
    assert track.column('ride.theta')[-1] > 0.005
    assert track.column('loads.fl.Fz')[-1] > track.column('loads.fl.Fz')[0] + 300
    expected = -3600 / with_wheels(equations.vehicle())
    assert track.column('acceleration.ax')[-1] == pytest.approx(expected, rel=0.01)
    assert track.column('wheels.fl.kappa')[-1] < 0


def test_the_split_of_brakes_and_drive_is_that_of_the_model(plant):
    """Whatever split was commanded; the sum is kept, and the actuators report what acts."""
    braked = drive(plant, lambda t: (0.0, 0.0, -2000.0), 1.5)
    driven = drive(plant, lambda t: (0.0, 0.0, 2000.0), 1.5)
    for track, total, front in ((braked, -2000.0, 0.66), (driven, 2000.0, 0.0)):
        forces = [track.column(f'servos.{axle}.position')[-1] for axle in ('front', 'rear')]
        assert forces == pytest.approx([front * total, (1 - front) * total], abs=1.0)
        torque = track.column('loads.fr.torque')[-1]
        assert torque == pytest.approx(front * total * equations.vehicle().R_w / 2, abs=1.0)


def test_grip_grows_with_the_friction_of_the_road(plant):
    peaks = {}
    for friction in (0.5, 1.0):
        track = drive(plant, lambda t: (0.1, 0.0, 0.0), 1.0, friction=friction)
        peaks[friction] = track.column('acceleration.ay').max()
    for friction, peak in peaks.items():
        mu = friction * plant.car.scaling.front.LMUY * equations.vehicle().tire.p_dy1
        # friction grows with the camber of a body that rolls
        assert 0.9 * mu * 9.81 < peak < 1.12 * mu * 9.81


def test_every_wheel_has_the_friction_under_it(plant):
    """Locked brakes, ice under the left wheels: they push less, and the car turns right."""
    ice = road_friction.patch_array([0, 0, 300, 0, 300, 30, 0, 30], [0.3])
    track = drive(plant, lambda t: (0.0, -3300.0, -1700.0), 0.5, patches=ice)
    left, right = (abs(track.column(f'loads.f{side}.Fx')[-1]) for side in 'lr')
    assert left < 0.5 * right
    assert track.column('planar.r')[-1] < -0.05


def test_brakes_stop_the_car_and_hold_it(plant):
    track = drive(plant, lambda t: (0.05, -3000.0, -1500.0), 5.0, speed=10.0)
    X = track.column('planar.X')
    assert np.isfinite(track.rows).all()
    assert (np.diff(X) >= -1e-6).all()
    assert track.column('planar.vx')[-1] == 0.0
    assert X[-1] == X[-500]
    # v^2 / 2a, and the servo that lags by 72 ms
    expected = 10.0**2 / 2 / (4500 / with_wheels(equations.vehicle())) + 10.0 * 0.072
    assert X[-1] == pytest.approx(expected, rel=0.03)


def test_a_standing_car_pulls_away(plant):
    track = drive(plant, lambda t: (0.0, 0.0, 2000.0), 4.0, speed=0.0)
    assert np.isfinite(track.rows).all()
    assert 4.0 < track.column('planar.vx')[-1] < 2000 / equations.vehicle().m * 4.0


def test_a_car_that_leaves_the_domain_slides_to_rest(plant):
    """Across the road the slips of the model divide by zero: Coulomb friction from there."""
    sideways = Start(0.0, 0.0, 0.0, 0.0, vy=15.0)
    track = drive(plant, lambda t: (0.2, -3000.0, -2000.0), 4.0, start=sideways)
    assert np.isfinite(track.rows).all()
    speed = np.hypot(track.column('planar.vx'), track.column('planar.vy'))
    mu_g = plant.car.scaling.front.LMUY * equations.vehicle().tire.p_dy1 * 9.81
    slope = (speed[500] - speed[100]) / 0.4
    assert slope == pytest.approx(-mu_g, rel=0.03)
    assert speed[-1] < 0.05
    assert track.column('planar.Y')[-1] == pytest.approx(15.0**2 / 2 / mu_g, rel=0.1)


def test_spinning_cars_stay_finite(plant):
    rng = np.random.default_rng(3)
    for _ in range(12):
        steer, brake = rng.uniform(-0.48, 0.48), rng.uniform(0.0, 6000.0)
        slide = Start(0.0, 0.0, 0.0, rng.uniform(5, 40), rng.uniform(-10, 10), rng.uniform(-2, 2))
        held = (steer, -brake, -brake / 2)
        track = drive(plant, lambda t, held=held: held, 3.0, start=slide)
        assert np.isfinite(track.rows).all()


def test_on_the_surface_of_its_tyre_test_the_car_rolls_over(plant):
    """So does the double track of the same car; both slide with the friction of the car file."""
    double = parameters.load(parameters.config_file('bmw_320i.yaml'))
    for car in (plant, double):
        ones = {'LMUX': 1.0, 'LMUY': 1.0}
        scaling = car.car.scaling
        scaling = replace(
            scaling, front=replace(scaling.front, **ones), rear=replace(scaling.rear, **ones)
        )
        gripping = replace(car, car=replace(car.car, scaling=scaling))
        assert drive(gripping, lambda t: (0.1, 0.0, 0.0), 2.0).column('ride.phi').max() > 0.3
        assert drive(car, lambda t: (0.1, 0.0, 0.0), 2.0).column('ride.phi').max() < 0.2


def test_a_fork_goes_the_same_way(plant):
    car = Simulator(plant, 1.0, Start(0.0, 0.0, 0.0, SPEED))
    car.advance(Command(car.stamp_ns, 0.05, 0.0, 0.0, 0.0), 130)
    other = car.fork()
    expected = car.advance(None, 70)
    assert (other.advance(None, 70).rows == expected.rows).all()


def test_the_start_has_pose_and_slide(plant):
    car = Simulator(plant, 1.0, Start(1.0, 2.0, 0.5, 15.0, vy=1.0, r=0.2))
    assert car.state[1:] == pytest.approx((1.0, 2.0, 0.5, 15.0, 1.0, 0.2))
    p = equations.vehicle()
    weight = p.m * 9.81
    loads = [float(car.now.column(f'loads.{w}.Fz')[0]) for w in WHEELS]
    assert sum(loads) == pytest.approx(weight, rel=1e-6)


def test_the_double_track_of_the_same_car_has_its_numbers(plant):
    p, car = equations.vehicle(), plant.car
    front, rear = car.suspension.front, car.suspension.rear
    pairs = (
        (car.body.mass_kg, p.m),
        (car.body.yaw_inertia_kgm2, p.I_z),
        (car.body.roll_inertia_kgm2, p.I_Phi_s),
        (car.body.pitch_inertia_kgm2, p.I_y_s),
        (car.body.cog_to_front_m, p.a),
        (car.body.cog_to_rear_m, p.b),
        (car.body.cog_height_m, p.h_cg),
        (front.track_m, p.T_f),
        (rear.track_m, p.T_r),
        (front.ride_rate_npm, p.K_sf),
        (rear.ride_rate_npm, p.K_sr),
        (front.antiroll_npm, -p.K_tsf / p.T_f**2),
        (rear.antiroll_npm, -p.K_tsr / p.T_r**2),
        (front.camber_per_roll, 1 + p.D_f * p.T_f / 2),
        (rear.camber_per_roll, 1 + p.D_r * p.T_r / 2),
        (2 * front.unsprung_mass_kg, p.m_uf),
        (car.wheel.radius_m, p.R_w),
        (car.wheel.spin_inertia_kgm2, p.I_y_w),
        (car.wheel.vertical_stiffness_npm, p.K_zt),
        (plant.tyre.longitudinal.PDX1, p.tire.p_dx1),
        (plant.tyre.longitudinal.PKX1, p.tire.p_kx1),
        (plant.tyre.lateral.PDY1, p.tire.p_dy1),
        # the slope of PKY1 FNOMIN sin(2 atan(Fz / (PKY2 FNOMIN)))
        (2 * plant.tyre.lateral.PKY1 / plant.tyre.lateral.PKY2, p.tire.p_ky1),
        (car.outline.width_m, p.w),
    )
    for ours, theirs in pairs:
        assert ours == pytest.approx(theirs, rel=1e-6)
    length = car.body.cog_to_front_m + car.body.cog_to_rear_m
    length += car.outline.front_overhang_m + car.outline.rear_overhang_m
    assert length == pytest.approx(p.l, abs=1e-4)


@pytest.mark.parametrize(
    ('name', 'value', 'text'),
    [
        ('car.body.mass_kg', 1500.0, r'car.body.mass_kg: is 1500.0; .* allowed 1093.295'),
        ('car.scaling.rear.LKY', 1.3, r'car.scaling.rear.LKY: .* allowed 1.0'),
        ('car.steering.rate_radps', 0.8, r'car.steering.rate_radps: is 0.8; .* at most 0.4'),
        ('tyre_set', 'tyre_book.yaml', r"tyre_set: .* allowed 'tyre_320i.yaml'"),
        ('model', 'carsim', r"model: is 'carsim'; allowed"),
    ],
)
def test_what_would_have_no_effect_is_refused(tmp_path, name, value, text):
    with pytest.raises(ParameterError, match=text):
        parameters.load(car_with(tmp_path, name, value))


def test_actuators_and_outline_may_change(tmp_path):
    plant = parameters.load(car_with(tmp_path, 'car.steering.rate_radps', 0.3))
    assert plant.car.steering.rate_radps == 0.3


def car_with(folder, name, value):
    """Return a file of the car in which one parameter differs."""
    path = folder / 'car.yaml'
    base = parameters.config_file(parameters.MULTI_BODY_CAR)
    path.write_text(f'/**:\n  ros__parameters:\n    base: {base}\n    {name}: {value}\n')
    return path


def test_without_the_package_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, 'vehiclemodels', None)
    with pytest.raises(ParameterError, match=r"model: .*pip install 'vehicle_plant\[commonroad\]'"):
        parameters.load(parameters.config_file(parameters.MULTI_BODY_CAR))
    # the same car as a double track does not need it
    assert parameters.load(parameters.config_file('bmw_320i.yaml')).car.body.mass_kg > 1000
