"""What sensors say of a drive: true but for errors of the stated sizes, and the same every time."""

from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest
from drives import altered, drive, load
from scipy.spatial.transform import Rotation

from node_runtime import parameters as yaml_parameters
from vehicle_plant import parameters
from vehicle_plant.initial_state import Start
from vehicle_plant.sensors import CHASSIS, GNSS, INERTIAL, SensorParams, Sensors
from vehicle_plant.simulator import Simulator
from vehicle_plant.state import Trajectory, join_trajectories

GRADES = ('consumer', 'automotive', 'survey')
G = load().car.body.gravity_mps2


def grade(name):
    return yaml_parameters.load(SensorParams, parameters.config_file(f'sensors_{name}.yaml'))


EXACT = SensorParams(
    imu=replace(grade('survey').imu, **dict.fromkeys(
        ('acceleration_bias_mps2', 'acceleration_noise', 'acceleration_walk',
         'rate_bias_radps', 'rate_noise', 'rate_walk'), 0.0)),
    chassis=replace(grade('survey').chassis, radius_error=0.0, steer_bias_rad=0.0,
                    steer_noise_rad=0.0, steer_step_rad=0.0),
    receiver=replace(grade('survey').receiver, position_noise_m=0.0, position_drift_m=0.0,
                     velocity_noise_mps=0.0, latency_ms=120),
)  # fmt: skip


@pytest.fixture(scope='module')
def swerve():
    """Three seconds of steering and braking, with the row of the start."""
    start = Simulator(load(), 1.0, Start(0.0, 0.0, 0.2, 20.0)).now
    track = drive(
        lambda t, car: (0.05 * np.sin(4 * t), *(2 * (-2500.0 * (t > 1.5),))),
        3.0,
        Start(0.0, 0.0, 0.2, 20.0),
    )
    return join_trajectories([start, track])


def measure(track, params, seed=1, pieces=1):
    """Return the columns of each topic, measured in so many pieces."""
    sensors = Sensors(params, load().car, seed, track.where(np.arange(len(track.rows)) == 0))
    values = defaultdict(list)
    for part in np.array_split(np.arange(len(track.rows)), pieces):
        for topic, value in sensors.measure(Trajectory(track.stamp_ns[part], track.rows[part])):
            values[topic].append(value)
    return {t: type(rows[0])(*map(np.array, zip(*rows))) for t, rows in values.items()}


def at(track, stamps):
    """Return the rows of a track at stamps."""
    return track.where(np.isin(track.stamp_ns, stamps))


def test_an_accelerometer_feels_what_carries_the_body_in_the_axes_of_the_body(swerve):
    imu = measure(swerve, EXACT)[INERTIAL]
    truth = at(swerve, imu.stamp_ns)
    column = truth.column
    force = np.column_stack(
        [column('acceleration.ax'), column('acceleration.ay'), np.full(len(imu.ax), G)]
    )
    body = Rotation.from_euler('xyz', np.column_stack(
        [column('ride.phi'), column('ride.theta'), np.zeros(len(imu.ax))]
    ))  # fmt: skip
    felt = body.inv().apply(force)
    # roll and pitch one after the other or as small angles: not the same, by their product
    assert np.column_stack([imu.ax, imu.ay]) == pytest.approx(felt[:, :2], abs=0.03)
    assert imu.r == pytest.approx(column('planar.r'), abs=1e-12)
    # outwards in a curve, so more than the car turns: some degrees per g
    share = np.polyfit(column('acceleration.ay'), imu.ay, 1)[0]
    assert 1.03 < share < 1.12


def test_teeth_give_the_mean_speed_of_a_wheel_since_the_last_message(swerve):
    chassis = measure(swerve, EXACT)[CHASSIS]
    assert chassis.delta == pytest.approx(
        at(swerve, chassis.stamp_ns).column('servos.steer.position'), abs=1e-12
    )
    for k, wheel in enumerate(('fl', 'fr', 'rl', 'rr')):
        omega = swerve.column(f'wheels.{wheel}.omega')
        ends = np.searchsorted(swerve.stamp_ns, chassis.stamp_ns)[3:]
        lowest, highest = (
            np.array([end(omega[max(i - 22, 0) : i + 1]) for i in ends]) for end in (min, max)
        )
        assert np.all(chassis.omega[3:, k] >= lowest - 1e-6)
        assert np.all(chassis.omega[3:, k] <= highest + 1e-6)


def test_a_locked_wheel_stands_within_half_a_second():
    locked = drive(lambda t, car: (0.0, -16_000.0, 0.0), 1.0)
    start = Simulator(load(), 1.0, Start(0.0, 0.0, 0.0, 20.0)).now
    chassis = measure(join_trajectories([start, locked]), EXACT)[CHASSIS]
    assert np.abs(locked.column('wheels.fl.omega')[-400:]).max() < 0.5
    assert chassis.omega[-1, :2].tolist() == [0.0, 0.0]
    assert chassis.omega[-1, 2] > 20.0


def test_a_fix_is_the_truth_of_its_stamp_and_arrives_late(swerve):
    sensors = Sensors(EXACT, load().car, 0, at(swerve, swerve.stamp_ns[0]))
    arrivals = {}
    for i in range(len(swerve.rows)):
        row = Trajectory(swerve.stamp_ns[i : i + 1], swerve.rows[i : i + 1])
        arrivals |= {v.stamp_ns: int(row.stamp_ns[0]) for t, v in sensors.measure(row) if t == GNSS}
    late = [arrived - taken for taken, arrived in arrivals.items()]
    assert late == [120_000_000] * len(late)
    fixes = measure(swerve, EXACT)[GNSS]
    assert fixes.stamp_ns.tolist() == list(arrivals)
    states = at(swerve, fixes.stamp_ns).state_columns()
    assert fixes.X[1:] == pytest.approx(states.X, abs=1e-12)
    # the first one is of before the start, at the velocity of the start
    assert np.hypot(fixes.X[0], fixes.Y[0]) == pytest.approx(0.12 * 20.0)
    speed = np.hypot(states.vx, states.vy)
    assert np.hypot(fixes.vX, fixes.vY)[1:] == pytest.approx(speed, abs=1e-9)


@pytest.mark.parametrize('name', GRADES)
def test_errors_are_a_function_of_seed_and_stamp_and_not_of_how_the_plant_advances(swerve, name):
    whole = measure(swerve, grade(name))
    for pieces in (61, len(swerve.rows)):
        parts = measure(swerve, grade(name), pieces=pieces)
        assert set(parts) == set(whole)
        for topic, columns in whole.items():
            assert all(map(np.array_equal, columns, parts[topic]))
    other = measure(swerve, grade(name), seed=2)
    assert not np.any(other[INERTIAL].ay == whole[INERTIAL].ay)


def test_rows_that_are_sent_again_bring_the_same_messages_again(swerve):
    start = at(swerve, swerve.stamp_ns[0])
    sensors = Sensors(grade('automotive'), load().car, 3, start)
    first = sensors.measure(start)
    assert {topic for topic, _ in first} == {INERTIAL, CHASSIS, GNSS}
    assert sensors.measure(start) == first


def test_errors_have_the_stated_sizes(swerve):
    """Over seeds biases, over time noise; intervals of 99.9 %."""
    params = grade('consumer')
    exact = measure(swerve, altered(EXACT, imu__period_ms=10))[INERTIAL]
    errors = np.array([measure(swerve, params, seed)[INERTIAL].ay - exact.ay for seed in range(60)])
    bias, noise = errors.mean(axis=1), np.diff(errors, axis=1) / np.sqrt(2)
    assert bias.std() == pytest.approx(params.imu.acceleration_bias_mps2, rel=0.33)
    density = noise.std() * np.sqrt(params.imu.period_ms / 1000)
    assert density == pytest.approx(params.imu.acceleration_noise, rel=0.03)


def test_outages_take_their_share_of_time():
    start = Simulator(load(), 1.0, Start(0.0, 0.0, 0.0, 20.0)).now
    params = altered(grade('consumer'), receiver__outage=0.3, receiver__outage_s=0.2)
    stamps = start.stamp_ns[0] + 1_000_000 * np.arange(200_000)
    rolling = Trajectory(stamps, np.repeat(start.rows, len(stamps), axis=0))
    fixes = measure(rolling, params)[GNSS]
    # 1000 slots of two fixes each: 0.3 +- 3.3 standard deviations
    assert len(fixes.X) / 2000 == pytest.approx(0.7, abs=0.05)
