"""The plant from outside: any commands, any speed, always the same answer."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msgs_yaml.types import WHEELS, Command
from vehicle_plant import parameters
from vehicle_plant.initial_state import Start
from vehicle_plant.simulator import START_NS, STEP_NS, TICK_STEPS, Simulator
from vehicle_plant.state import join_trajectories, wrap_angle

PARAMS = parameters.load()
CAR = PARAMS.car


@st.composite
def set_points(draw):
    low, high = -CAR.steering.limit_rad, CAR.steering.limit_rad
    delta = draw(st.sampled_from([low, 0.0, high]) | st.floats(low, high))
    Fxf = draw(st.sampled_from([-CAR.force.front.brake_n, 0.0]) | st.floats(-8e3, 0.0))
    Fxr = draw(st.sampled_from([-12e3, 0.0, 7e3]) | st.floats(-6e3, 6e3))
    return delta, Fxf, Fxr


@settings(max_examples=100)
@given(
    commands=st.lists(set_points(), min_size=3, max_size=8),
    speed=st.sampled_from([0.0, 0.05, 1.0, 8.0, 25.0, 45.0]) | st.floats(0.0, 45.0),
    friction=st.sampled_from([0.1, 0.6, 1.0]) | st.floats(0.1, 1.2),
)
def test_no_command_makes_it_leave_physics(commands, speed, friction):
    """Full lock, full brakes, full throttle from standstill or 45 m/s: finite and bounded."""
    car = Simulator(PARAMS, friction, Start(0.0, 0.0, 0.0, speed))
    rows = []
    for target in commands:
        car.command(Command(car.stamp_ns, target[0], 0.0, target[1], target[2]))
        rows.append(car.advance(None, 6 * TICK_STEPS))
    track = join_trajectories(rows)
    assert np.isfinite(track.rows).all()
    v = np.hypot(track.column('planar.vx'), track.column('planar.vy'))
    driven = len(commands) * 0.3 * CAR.force.rear.drive_n / CAR.body.mass_kg
    assert v.max() <= speed + driven + 0.7
    assert np.abs(track.column('servos.steer.position')).max() <= CAR.steering.limit_rad
    # far beyond normal driving, far inside what is impossible
    for name, limit in (('phi', 0.15), ('theta', 0.1), ('z', 0.08)):
        assert np.abs(track.column(f'ride.{name}')).max() <= limit
    for w in WHEELS:
        assert np.abs(track.column(f'wheels.{w}.windup')).max() <= 1.0
        Fz = track.column(f'loads.{w}.Fz')
        assert Fz.max() <= 1.1 * CAR.body.mass_kg * CAR.body.gravity_mps2
        F = np.hypot(track.column(f'loads.{w}.Fx'), track.column(f'loads.{w}.Fy'))
        # the published tyre gains friction as load falls; camber adds to it
        assert (1.6 * friction * Fz + 10.0 >= F).all()
        assert greatest_slip(track, w) <= 1.01 * CAR.wheel.greatest_slip


def greatest_slip(track, w):
    """Return the larger of both slips of a wheel over a trajectory."""
    return max(np.abs(track.column(f'wheels.{w}.{n}')).max() for n in ('kappa', 'tan_alpha'))


@pytest.mark.parametrize('speed', [0.0, 25.0])
def test_wheels_that_spin_up_on_ice_keep_their_slip_bounded(drive, speed):
    """Full throttle for three seconds: the rims race, the slips stay."""
    track = drive(lambda t, car: (0.0, 0.0, CAR.force.rear.drive_n), 3.0, speed, friction=0.1)
    assert track.column('planar.vx')[-1] > speed
    for w in WHEELS:
        assert greatest_slip(track, w) <= 1.01 * CAR.wheel.greatest_slip


@pytest.mark.parametrize('side', [-1, 1])
def test_full_brakes_at_full_lock_end_at_standstill(drive, side):
    front, rear = CAR.force.front.brake_n, CAR.force.rear.brake_n

    def law(t, car):
        return side * min(t, CAR.steering.limit_rad), -front, -rear

    track = drive(law, 4.0, 8.0, friction=0.5)
    assert np.abs(track.column('planar.vx')[-500:]).max() < 0.05
    for w in WHEELS:
        rim = track.column(f'wheels.{w}.omega')[-500:] * CAR.wheel.radius_m
        assert np.abs(rim).max() < 0.1


@pytest.mark.parametrize('brakes', [(-6000.0, -3500.0), (-16000.0, -12000.0)])
def test_braking_ends_at_standstill_and_stays_there(drive, brakes):
    """Rolling and with locked wheels: after rocking back the car rests, without chatter."""
    track = drive(lambda t, car: (0.0, *brakes), 5.0, 12.0)
    last = -1000
    assert np.abs(track.column('planar.vx')[last:]).max() < 0.01
    assert np.ptp(track.column('planar.X')[last:]) < 0.005
    for w in WHEELS:
        assert np.abs(track.column(f'wheels.{w}.omega')[last:]).max() < 0.05
    assert track.column('planar.vx').min() > -0.6


def test_brakes_hold_the_standing_car_against_the_engine(drive):
    """Front brakes on, some drive at the rear: it winds up by millimetres and stands."""
    track = drive(lambda t, car: (0.0, -6000.0 * (t >= 0.0), 1500.0 * (t > 1.0)), 5.0, 0.0)
    assert abs(track.column('planar.X')[-1]) < 0.02
    assert abs(track.column('planar.vx')[-1]) < 1e-3


def test_engine_moves_the_standing_car(drive):
    track = drive(lambda t, car: (0.0, 0.0, 3000.0), 3.0, 0.0)
    body, wheel = CAR.body, CAR.wheel
    mass = body.mass_kg + 4 * wheel.spin_inertia_kgm2 / wheel.radius_m**2
    rolling = wheel.rolling_resistance * body.mass_kg * body.gravity_mps2
    assert track.column('acceleration.ax')[-1] == pytest.approx((3000 - rolling) / mass, rel=0.02)


def test_same_commands_give_the_same_bits(drive):
    def law(t, car):
        return 0.1 * np.sin(2 * t), -5000.0 * (t > 1), 1000.0 * np.cos(t)

    assert drive(law, 2.0, 25.0).rows.tobytes() == drive(law, 2.0, 25.0).rows.tobytes()


def test_bursts_of_any_length_give_the_same_track():
    command = Command(START_NS, 0.05, 0.0, -800.0, 300.0)
    whole = Simulator(PARAMS, 1.0, Start(0.0, 0.0, 0.0, 20.0))
    parts = Simulator(PARAMS, 1.0, Start(0.0, 0.0, 0.0, 20.0))
    a = whole.advance(command, 50)
    pieces = [parts.advance(command, 17), parts.advance(None, 1), parts.advance(None, 32)]
    assert np.allclose(a.rows, join_trajectories(pieces).rows, rtol=0, atol=1e-10)
    assert a.stamp_ns.tolist() == join_trajectories(pieces).stamp_ns.tolist()


def test_stamps_count_milliseconds_from_the_start():
    car = Simulator(PARAMS, 1.0, Start(3.0, 4.0, 0.5, 20.0))
    assert car.state == (START_NS, 3.0, 4.0, 0.5, 20.0, 0.0, 0.0)
    track = car.advance(None, 3)
    assert track.stamp_ns.tolist() == [START_NS + i * STEP_NS for i in (1, 2, 3)]
    assert car.state == track.states()[2]
    assert car.now.wheels() == track.wheels()[2:]
    assert car.now.imu() == track.imu()[2:]
    assert car.actuators == track.actuators()[2]


def test_start_must_be_finite_and_friction_sensible():
    with pytest.raises(ValueError, match='friction'):
        Simulator(PARAMS, 0.0, Start(0.0, 0.0, 0.0, 20.0))
    with pytest.raises(ValueError, match='finite'):
        Simulator(PARAMS, 1.0, Start(0.0, np.nan, 0.0, 20.0))


def test_heading_is_reported_between_minus_pi_and_pi():
    assert wrap_angle(np.pi) == np.pi
    assert wrap_angle(-np.pi) == np.pi
    assert wrap_angle(7.0) == pytest.approx(7.0 - 2 * np.pi)


def test_safe_stop_straightens_and_stops_the_car(drive):
    car = Simulator(PARAMS, 1.0, Start(0.0, 0.0, 0.0, 20.0))
    car.advance(Command(START_NS, 0.1, 0.0, 0.0, 0.0), 300)
    car.brake_straight()
    car.advance(None, 5000)
    assert abs(car.actuators.delta) < 1e-6
    assert abs(car.state.vx) < 0.01
