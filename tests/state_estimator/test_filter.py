"""The filter against the truth of the plant, and against least squares over a whole drive."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from drives import load
from estimated_drives import (
    START,
    car,
    errors,
    estimate,
    grade,
    moved,
    params,
    readings,
    track,
    without,
)
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from experiments import estimation
from mpcc_controller import car_file
from mpcc_controller.model import fiala
from msgs_yaml.types import Chassis, Gnss, Inertial
from state_estimator import vehicle_model
from state_estimator.estimators import Stream
from state_estimator.vehicle_model import tyre_force

AT_THE_LIMIT = [(0.03, 2.0, 0.0), (0.06, 3.0, 9000.0), (0.08, 4.0, 0.0), (0.05, 1.5, 14000.0)]


@pytest.mark.parametrize('name', ['consumer', 'automotive', 'survey'])
def test_errors_are_within_the_stated_two_sigma_and_these_are_no_excuse(name):
    all_errors, all_sds = [], []
    for seed, course in enumerate(AT_THE_LIMIT * 2):
        driven = track(*course)
        _, results = estimate(readings(driven, name, seed), params(name))
        for stack, values in zip((all_errors, all_sds), errors(driven, results)):
            stack.append(values)
    error, sd = np.vstack(all_errors), np.vstack(all_sds)
    inside = (np.abs(error) <= 2 * sd).mean(axis=0)
    assert np.all(inside >= 0.94), inside
    sideslip = np.degrees(np.sqrt((error[:, 4] ** 2).mean()) / 20.0)
    assert sideslip < {'consumer': 0.5, 'automotive': 0.3, 'survey': 0.25}[name]
    assert np.degrees(np.median(sd[:, 4]) / 20.0) < 1.0


def test_the_sideslip_is_less_than_half_as_wrong_as_by_integration():
    worst = {}
    for method in ('filter', 'kinematic', 'raw'):
        squares = []
        for course in AT_THE_LIMIT:
            driven = track(*course)
            _, results = estimate(readings(driven), params(method=method))
            squares.append(errors(driven, results)[0][:, 4] ** 2)
        worst[method] = np.sqrt(np.concatenate(squares).mean())
    assert worst['filter'] < 0.5 * min(worst['kinematic'], worst['raw']), worst


def test_a_slippery_road_is_told_from_the_tyres_that_slide():
    driven = track(0.06, 3.0, 0.0, friction=0.45)
    _, results = estimate(readings(driven))
    assert min(r.friction for r in results) == pytest.approx(0.45, abs=0.12)
    error, sd = errors(driven, results)
    assert (np.abs(error[:, 4]) <= 2 * sd[:, 4]).mean() > 0.9


def integrate(imus, first):
    """Return pose and velocity (n, 5) at the stamps of the IMU, in steps of Heun."""
    X, Y, psi, vx, vy, b_x, b_y, b_r = first
    roll, pitch = 1 + 9.81 * car().roll_radps2, 1 + 9.81 * car().pitch_radps2
    rows = [np.array([X, Y, psi, vx, vy])]

    def slope(x, imu):
        r = imu.r - b_r
        c, s = np.cos(x[2]), np.sin(x[2])
        ax, ay = (imu.ax - b_x) / pitch, (imu.ay - b_y) / roll
        return np.array([x[3] * c - x[4] * s, x[3] * s + x[4] * c, r, ax + r * x[4], ay - r * x[3]])

    for before, after in pairwise(imus):
        dt = (after.stamp_ns - before.stamp_ns) / 1e9
        k = slope(rows[-1], before)
        rows.append(rows[-1] + dt / 2 * (k + slope(rows[-1] + dt * k, after)))
    return np.array(rows)


def test_without_noise_of_the_process_it_ends_where_least_squares_over_all_fixes_does():
    """Late fixes, biases, prior: none of it may count twice, or not at all."""
    nothing = {'tyre_noise_mps2': 5.0, 'tyre_time_s': 10.0, 'tyre_error': 1.0, 'misfit': 1000.0}
    nothing |= {'wheel_noise_mps': 2.0, 'wheel_time_s': 10.0, 'wheel_error': 0.2, 'roll_noise': 0.0}
    nothing |= {'acceleration_noise': 0.0, 'acceleration_walk': 0.0, 'rate_noise': 1e-6}
    nothing |= {'rate_walk': 0.0, 'position_walk': 0.0, 'position_drift_m': 0.0}
    nothing |= {'roll_time_s': 0.02, 'pitch_noise': 0.0}
    p = params('consumer', **nothing)
    driven = track(0.02, 2.0)
    messages = readings(driven, 'consumer', 5)
    # what an axle says is of no weight, and roll is steady: the roll rate is not told
    messages = [
        m._replace(value=m.value._replace(p=0.0)) if isinstance(m.value, Inertial) else m
        for m in messages
    ]
    _, results = estimate(messages, p)
    imus = [m.value for m in messages if isinstance(m.value, Inertial)]
    fixes = [m.value for m in messages if isinstance(m.value, Gnss)]
    first, *later = fixes
    at = np.searchsorted([imu.stamp_ns for imu in imus], [fix.stamp_ns for fix in later])
    late = (imus[0].stamp_ns - first.stamp_ns) / 1e9
    speed, course = np.hypot(first.vX, first.vY), np.arctan2(first.vY, first.vX)
    x0 = np.array([first.X + late * first.vX, first.Y + late * first.vY, course, speed, *[0.0] * 4])
    at_m, slide = p.position_noise_m, p.start_sideslip_rad
    yaw = np.hypot(p.velocity_noise_mps / speed, slide)
    prior = np.diag(
        [at_m**2, at_m**2, yaw**2, p.velocity_noise_mps**2,
         p.velocity_noise_mps**2 + (slide * speed) ** 2,
         p.acceleration_bias_mps2**2, p.acceleration_bias_mps2**2, p.rate_bias_radps**2]
    )  # fmt: skip
    prior[2, 4] = prior[4, 2] = -speed * slide**2
    whiten = np.linalg.inv(np.linalg.cholesky(prior))

    def residuals(x):
        rows = integrate(imus, x)[at]
        c, s = np.cos(rows[:, 2]), np.sin(rows[:, 2])
        velocity = rows[:, 3] * c - rows[:, 4] * s, rows[:, 3] * s + rows[:, 4] * c
        off = [
            (rows[:, 0] - [f.X for f in later]) / at_m,
            (rows[:, 1] - [f.Y for f in later]) / at_m,
            (velocity[0] - [f.vX for f in later]) / p.velocity_noise_mps,
            (velocity[1] - [f.vY for f in later]) / p.velocity_noise_mps,
        ]
        return np.concatenate([whiten @ (x - x0), *off])

    whole = least_squares(residuals, x0, method='lm')
    end = integrate(imus, whole.x)[-1]
    believed, sd = results[-1].state, np.sqrt(np.diag(results[-1].covariance))
    distance = (np.array(believed[1:6]) - end) / sd[:5]
    assert np.abs(distance).max() < 0.35, distance
    # how sure: by the slopes of the end over the first state
    step = 1e-5
    slopes = np.column_stack(
        [(integrate(imus, whole.x + step * e)[-1] - end) / step for e in np.eye(8)]
    )
    cov = slopes @ np.linalg.inv(whole.jac.T @ whole.jac) @ slopes.T
    assert sd[:5] == pytest.approx(np.sqrt(np.diag(cov)), rel=0.25)


@given(
    st.floats(-0.5, 0.5), st.floats(50.0, 200.0), st.floats(2.0, 10.0)
)  # fmt: skip
def test_the_slopes_of_the_tyre_are_those_of_its_force(tan_alpha, C, capacity):
    force, over_slip, over_capacity = tyre_force(tan_alpha, C, capacity)
    h = 1e-6
    step = (tyre_force(tan_alpha + h, C, capacity)[0] - force) / h
    assert over_slip == pytest.approx(step, abs=2e-2)
    step = (tyre_force(tan_alpha, C, capacity + h)[0] - force) / h
    assert over_capacity == pytest.approx(step, abs=1e-3)
    assert abs(force) <= capacity * (1 + 1e-12)


@given(st.floats(-0.2, 0.2), st.floats(0.2, 1.0), st.floats(-12.0, 9.0))
def test_the_slope_over_friction_is_that_of_the_force_of_an_axle(tan_alpha, friction, ax):
    """Also where the longitudinal force would leave less than the least capacity."""
    for axle in vehicle_model.axles(car()):
        h, load = 1e-6, vehicle_model.G + axle.transfer * ax
        wanted, most = abs(ax) * load / vehicle_model.G, axle.friction * friction * load
        if abs(wanted / (vehicle_model.MOST_USED * most) - 1.0) < 1e-4:
            continue  # a corner of the force
        low, high = (axle.force(tan_alpha, ax, friction + side * h)[0] for side in (-1, 1))
        slope = (high - low) / (2 * h)
        assert axle.force(tan_alpha, ax, friction)[2] == pytest.approx(slope, rel=1e-3, abs=1e-3)


def test_what_is_missing_is_named_and_believed_less_and_comes_back():
    driven = track(0.05, 2.0, seconds=8.0)
    whole = readings(driven)
    _, full = errors(driven, estimate(whole)[1])
    for kind, name in ((Gnss, 'no receiver'), (Chassis, 'no chassis')):
        estimator, results = estimate(without(whole, kind, 2.0, 5.0))
        assert estimator.resets == 0
        zero = results[0].state.stamp_ns
        status = {round((r.state.stamp_ns - zero) / 1e9, 3): r.status for r in results}
        assert (status[1.5], status[4.5], status[7.5]) == ('ok', name, 'ok')
        error, sd = errors(driven, results)
        assert (np.abs(error[:, :5]) <= 2.5 * sd[:, :5]).mean() > 0.93
        lost = round(4.9 / 0.005)
        blurred = slice(0, 2) if kind is Gnss else slice(3, 4)  # position; speed
        assert np.all(sd[lost, blurred] > full[lost, blurred])


def test_wheels_that_say_no_number_are_left_out():
    driven = track(0.02, 2.0)
    rear = [
        m._replace(value=m.value._replace(omega=(np.nan, np.nan, *m.value.omega[2:])))
        if isinstance(m.value, Chassis)
        else m
        for m in readings(driven)
    ]
    estimator, results = estimate(rear)
    assert estimator.resets == 0
    error, sd = errors(driven, results)
    assert (np.abs(error) <= 2.5 * sd).mean() > 0.93


def test_one_wrong_fix_is_left_out_and_a_receiver_that_stays_elsewhere_is_believed():
    driven = track(0.02, 2.0, seconds=8.0)
    whole = readings(driven)
    estimator, results = estimate(moved(whole, 3.0, 3.1, 25.0))
    assert estimator.resets == 0
    assert np.abs(errors(driven, results)[0][:, 1]).max() < 0.2
    estimator, results = estimate(moved(whole, 3.0, 99.0, 25.0))
    assert estimator.resets == 1
    assert errors(driven, results)[0][-1, 1] == pytest.approx(25.0, abs=0.2)


def test_a_car_that_stands_is_known_to_stand():
    driven = track(0.0, 1.0, seconds=12.0, stops=True)
    assert np.hypot(*driven.state_columns()[4:6])[-1000:].max() < 0.01
    _, results = estimate(readings(driven))
    end = results[-1]
    assert np.hypot(end.state.vx, end.state.vy) < 0.01
    assert abs(end.state.r) < 0.01
    headings = np.array([r.state.psi for r in results[-200:]])
    assert np.ptp(headings) < 1e-3
    assert abs(end.state.X - driven.state_columns().X[-1]) < 0.1


def test_a_pause_of_the_imu_begins_anew_at_once_and_says_how_little_it_knows():
    driven = track(0.02, 2.0)
    estimator, results = estimate(without(readings(driven), Inertial, 2.0, 2.5))
    assert (estimator.resets, estimator.reason) == (1, '0.505 s between two messages of the IMU')
    stamps = [r.state.stamp_ns for r in results]
    assert np.diff(stamps).max() == 505_000_000
    error, sd = errors(driven, results)
    after = int(np.diff(stamps).argmax()) + 1
    assert np.all(np.abs(error[after:]) < 4 * sd[after:])
    assert np.all(sd[after, :5] > sd[after - 1, :5])
    assert np.abs(error[-1, :2]).max() < 0.2


def test_a_car_that_stands_keeps_its_heading_when_the_filter_begins_anew():
    driven = track(0.05, 1.0, seconds=14.0, stops=True)
    turned = driven.state_columns().psi[-1]
    assert abs(turned - START.psi) > 0.1
    estimator, results = estimate(without(readings(driven), Inertial, 12.0, 12.5))
    assert estimator.resets == 1
    assert results[-1].state.psi == pytest.approx(turned, abs=0.03)


def test_a_state_that_is_no_number_is_begun_anew_with_the_same_message():
    messages = readings(track(0.02, 2.0))
    estimator, before = estimate(messages[:1000])
    estimator._now.x[3] = np.nan
    after = [result for m in messages[1000:] if (result := estimator.update(m.value))]
    assert (estimator.resets, len(before) + len(after)) == (1, len(estimate(messages)[1]))
    assert np.isfinite(np.array([r.state[1:] for r in after])).all()
    assert all((np.linalg.eigvalsh(r.covariance) > 0).all() for r in after)


def test_repeated_messages_change_nothing_and_older_ones_begin_a_drive():
    messages = [m.value for m in readings(track(0.02, 2.0))]
    once, twice = Stream(params()), Stream(params())
    expected = [once.take(m) for m in messages]
    for m, estimated in zip(messages, expected):
        first, again = twice.take(m), twice.take(m)
        assert (first is None) == (estimated is None)
        assert again is first
        assert first is None or first.as_message() == estimated.as_message()
    assert [e and e.as_message() for e in map(twice.take, messages)] == [
        e and e.as_message() for e in expected
    ]


def test_a_fix_of_a_car_that_is_held_begins_a_drive():
    stream, messages = Stream(params()), [m.value for m in readings(track(0.02, 2.0))[:3]]
    assert [type(m) for m in messages] == [Gnss, Chassis, Inertial]
    stream.is_held = True
    for k in range(50):  # at 20 m/s, and it stays where it is
        later = [m._replace(stamp_ns=m.stamp_ns + k * 20_000_000) for m in messages]
        held = [stream.take(m) for m in later][-1]
        assert np.hypot(held.state.X - START.X, held.state.Y - START.Y) < 0.2
    assert stream.resets == 0


def test_the_message_holds_the_covariance_of_pose_and_twist():
    _, results = estimate(readings(track(0.02, 2.0)))
    message, P = results[-1].as_message(), results[-1].covariance
    assert message.state == results[-1].state
    assert message[7:13] == (P[0, 0], P[0, 1], P[0, 2], P[1, 1], P[1, 2], P[2, 2])
    assert message[13:] == (P[3, 3], P[3, 4], P[3, 5], P[4, 4], P[4, 5], P[5, 5])
    for method in ('kinematic', 'raw'):  # they state none
        _, results = estimate(readings(track(0.02, 2.0)), params(method=method))
        assert not any(results[-1].as_message()[7:])


def test_nothing_is_believed_before_every_sensor_has_spoken():
    messages = readings(track(0.02, 2.0))
    for kind in (Gnss, Chassis):
        assert estimate(without(messages, kind, -1.0, 99.0))[1] == []
    first = estimate(messages)[1][0]
    assert first.state.psi == pytest.approx(START.psi, abs=0.05)
    assert grade().receiver.latency_ms > 0


def test_the_front_stiffness_is_that_of_the_tyre_and_a_soft_steering():
    stiff = car_file.read('car.yaml')
    tyre = replace(stiff.tyre, compliance_radpn=1e-5)
    soft = estimation.vehicle(replace(stiff, tyre=tyre), load().car)
    C, capacity, tan_alpha = tyre.front_cornering_npr, 8e3, 1e-6
    left = fiala.remaining_slip(tan_alpha, capacity, C, 0.95, tyre.compliance_radpn)
    force = -float(fiala.lateral_force(left, capacity, C, 0.95))
    assert soft.front_cornering_npr == pytest.approx(force / tan_alpha, rel=1e-3)
