"""The plant from outside: any commands, any speed, always the same answer."""

import re

import numpy as np
import pytest
from drives import ahead, drive, load
from hypothesis import given, settings
from hypothesis import strategies as st
from installation import ROOT

from msgs_yaml.types import WHEELS, Command
from node_runtime import named_vector
from vehicle_plant import parameters
from vehicle_plant.simulator import START_NS, TICK_STEPS, Simulator
from vehicle_plant.state import State, join_trajectories, wrap_angle

CAR = load().car
LIMIT = CAR.steering.limit_rad


@st.composite
def set_points(draw):
    delta = draw(st.sampled_from([-LIMIT, 0.0, LIMIT]) | st.floats(-LIMIT, LIMIT))
    Fxf = draw(st.sampled_from([-CAR.force.front.brake_n, 0.0]) | st.floats(-8e3, 0.0))
    Fxr = draw(st.sampled_from([-12e3, 0.0, 7e3]) | st.floats(-6e3, 6e3))
    return delta, Fxf, Fxr


def greatest_slip(track):
    """Return the larger of both slips of any wheel over a trajectory."""
    names = [f'wheels.{w}.{n}' for w in WHEELS for n in ('kappa', 'tan_alpha')]
    return max(np.abs(track.column(name)).max() for name in names)


@settings(max_examples=60)
@given(
    commands=st.lists(set_points(), min_size=3, max_size=8),
    speed=st.sampled_from([0.0, 0.05, 1.0, 8.0, 25.0, 45.0]) | st.floats(0.0, 45.0),
    friction=st.sampled_from([0.1, 0.6, 1.0]) | st.floats(0.1, 1.2),
)
def test_no_command_makes_it_leave_physics(commands, speed, friction):
    """Full lock, full brakes, full throttle from standstill or 45 m/s: finite and bounded."""
    car = Simulator(load(), friction, ahead(speed))
    rows = []
    for target in commands:
        car.command(Command(car.stamp_ns, target[0], 0.0, target[1], target[2]))
        rows.append(car.advance(None, 6 * TICK_STEPS))
    track = join_trajectories(rows)
    assert np.isfinite(track.rows).all()
    v = np.hypot(track.column('planar.vx'), track.column('planar.vy'))
    driven = len(commands) * 0.3 * CAR.force.rear.drive_n / CAR.body.mass_kg
    assert v.max() <= speed + driven + 0.7
    assert np.abs(track.column('servos.steer.position')).max() <= LIMIT
    # far beyond normal driving, far inside what is impossible
    for name, limit in (('phi', 0.15), ('theta', 0.1), ('z', 0.08)):
        assert np.abs(track.column(f'ride.{name}')).max() <= limit
    assert greatest_slip(track) <= 1.01 * CAR.wheel.greatest_slip
    for w in WHEELS:
        assert np.abs(track.column(f'wheels.{w}.windup')).max() <= 1.0
        Fx, Fy, Fz = (track.column(f'loads.{w}.{name}') for name in ('Fx', 'Fy', 'Fz'))
        assert Fz.max() <= 1.1 * CAR.body.mass_kg * CAR.body.gravity_mps2
        # the published tyre gains friction as load falls; camber adds to it
        assert (1.6 * friction * Fz + 10.0 >= np.hypot(Fx, Fy)).all()


@pytest.mark.parametrize('speed', [0.0, 25.0])
def test_wheels_that_spin_up_on_ice_keep_their_slip_bounded(speed):
    """Full throttle for three seconds: the rims race, the slips stay."""
    track = drive(lambda t, car: (0.0, 0.0, CAR.force.rear.drive_n), 3.0, speed, friction=0.1)
    assert track.column('planar.vx')[-1] > speed
    assert greatest_slip(track) <= 1.01 * CAR.wheel.greatest_slip


@pytest.mark.parametrize(
    ('steer', 'brakes', 'speed', 'friction', 'creep', 'spin'),
    [
        pytest.param(0.0, (-6000.0, -3500.0), 12.0, 1.0, 0.01, 0.05, id='rolling'),
        pytest.param(0.0, (-16000.0, -12000.0), 12.0, 1.0, 0.01, 0.05, id='locked'),
        pytest.param(LIMIT, (-16000.0, -12000.0), 8.0, 0.5, 0.05, 0.3, id='full lock'),
    ],
)
def test_braking_ends_at_standstill_and_stays_there(steer, brakes, speed, friction, creep, spin):
    """After rocking back the car rests, without chatter."""
    track = drive(lambda t, car: (min(t, steer), *brakes), 5.0, speed, friction=friction)
    last = -500
    assert np.abs(track.column('planar.vx')[last:]).max() < creep
    assert np.ptp(track.column('planar.X')[last:]) < 0.01
    for w in WHEELS:
        assert np.abs(track.column(f'wheels.{w}.omega')[last:]).max() < spin
    assert track.column('planar.vx').min() > -0.6


def test_brakes_hold_the_standing_car_against_the_engine():
    """Front brakes on, some drive at the rear: it winds up by millimetres and stands."""
    track = drive(lambda t, car: (0.0, -6000.0, 1500.0 * (t > 1.0)), 5.0, 0.0)
    assert abs(track.column('planar.X')[-1]) < 0.02
    assert abs(track.column('planar.vx')[-1]) < 1e-3


def test_same_commands_give_the_same_bits_and_a_fork_goes_the_same_way(params):
    command = Command(START_NS, 0.05, 0.0, -800.0, 300.0)
    cars = [Simulator(params, 1.0, ahead(20.0)) for _ in range(2)]
    first, second = (car.advance(command, 130).rows for car in cars)
    assert first.tobytes() == second.tobytes()
    forked = cars[0].fork()
    refused = command._replace(Fxf=np.nan)
    assert not forked.command(refused).accepted
    expected = cars[1].advance(None, 70)
    assert cars[0].gate.rejected == 0
    assert np.array_equal(forked.advance(None, 70).rows, expected.rows)
    assert np.array_equal(cars[0].advance(None, 70).rows, expected.rows)


def test_the_manual_counts_the_states():
    text = (ROOT / 'docs/plant.md').read_text()
    numbers = re.findall(r'^\|.*\| (\d+)( per wheel)? \|', text, flags=re.MULTILINE)
    total = sum(int(n) * (4 if each else 1) for n, each in numbers)
    assert total == len(named_vector.names(State)) == 42
    assert f'{total} states' in text
    for name in re.findall(r'`(\w+\.yaml)`', text):
        assert parameters.config_file(name).is_file()


@pytest.mark.parametrize(
    ('friction', 'start', 'message'),
    [
        (0.0, ahead(20.0), 'friction is 0.0'),
        (np.inf, ahead(20.0), 'friction is inf'),
        (1.0, ahead(20.0)._replace(Y=np.nan), 'the start is not finite'),
    ],
)
def test_start_must_be_finite_and_friction_sensible(params, friction, start, message):
    with pytest.raises(ValueError, match=message):
        Simulator(params, friction, start)


def test_heading_is_reported_between_minus_pi_and_pi():
    assert wrap_angle(np.pi) == np.pi
    assert wrap_angle(-np.pi) == np.pi
    assert wrap_angle(7.0) == pytest.approx(7.0 - 2 * np.pi)
