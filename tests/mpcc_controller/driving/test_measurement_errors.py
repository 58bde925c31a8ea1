"""A controller with measurement errors answers another world; without, the one it receives."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.measurement_errors import measured_obstacles, measured_state
from mpcc_controller.parameters import MeasurementErrors
from msgs_yaml.types import Obstacle, Obstacles, VehicleState

NONE = MeasurementErrors(
    **dict.fromkeys(field.name for field in dataclasses.fields(MeasurementErrors))
)
TICK_NS = 50_000_000
CAR = VehicleState(TICK_NS, 10.0, -2.0, 0.3, 20.0, 0.5, 0.2)
WORLD = Obstacles(
    TICK_NS, (Obstacle(1, 40.0, 0.0, 1.0, 0.0, 0.0), Obstacle(2, 90.0, 1.0, 2.0, 0.0, 0.0))
)


def errors(**values):
    return dataclasses.replace(NONE, **values)


def see(stamp_ns, params, car=CAR, world=WORLD):
    return measured_obstacles(world, car, stamp_ns, params).items


def test_without_errors_nothing_is_changed():
    assert measured_state(CAR, errors(seed=3)) is CAR
    assert measured_obstacles(WORLD, CAR, TICK_NS, errors(seed=3)) is WORLD


@given(psi=st.floats(-7.0, 7.0), ahead=st.floats(-1.0, 1.0), left=st.floats(-1.0, 1.0))
def test_the_bias_of_the_position_is_in_the_frame_of_the_car(psi, ahead, left):
    truth = CAR._replace(psi=psi)
    x = measured_state(truth, errors(ahead_bias_m=ahead, left_bias_m=left))
    offset = complex(x.X - truth.X, x.Y - truth.Y) * np.exp(-1j * psi)
    assert offset == pytest.approx(complex(ahead, left), abs=1e-9)
    assert x[3:] == pytest.approx(truth[3:])


@given(angle=st.floats(-0.3, 0.3), share=st.floats(-0.3, 0.3))
def test_sideslip_and_speed_have_errors_of_their_own(angle, share):
    x = measured_state(CAR, errors(sideslip_bias_rad=angle, speed_error=share))
    assert np.hypot(x.vx, x.vy) == pytest.approx((1 + share) * np.hypot(CAR.vx, CAR.vy))
    turned = np.arctan2(x.vy, x.vx) - np.arctan2(CAR.vy, CAR.vx)
    assert turned == pytest.approx(angle, abs=1e-9)


def test_the_noise_has_its_deviations_and_is_white():
    deviations = {
        'position_noise_m': 0.1,
        'yaw_noise_rad': 0.01,
        'speed_noise_mps': 0.3,
        'lateral_speed_noise_mps': 0.2,
        'yaw_rate_noise_radps': 0.02,
    }
    params = errors(seed=5, **deviations)
    truth = np.array(CAR._replace(psi=0.0)[1:])
    rows = [
        np.array(measured_state(CAR._replace(stamp_ns=k * TICK_NS, psi=0.0), params)[1:]) - truth
        for k in range(4000)
    ]
    noise = np.array(rows) / (0.1, 0.1, 0.01, 0.3, 0.2, 0.02)
    assert np.mean(noise, axis=0) == pytest.approx(np.zeros(6), abs=0.08)
    assert np.cov(noise.T) == pytest.approx(np.eye(6), abs=0.1)
    assert np.mean(noise[1:] * noise[:-1], axis=0) == pytest.approx(np.zeros(6), abs=0.08)


def test_the_errors_of_a_stamp_are_always_the_same_and_of_a_seed_its_own():
    first, again, other = (
        errors(seed=seed, speed_noise_mps=0.3, obstacle_noise_m=0.2) for seed in (1, 1, 2)
    )
    assert measured_state(CAR, first) == measured_state(CAR, again) != measured_state(CAR, other)
    assert see(7, first) == see(7, again) != see(7, other)


def test_obstacles_beyond_the_range_are_not_seen():
    assert [o.id for o in see(0, errors(obstacle_range_m=50.0))] == [1]
    # the range ends at the surface, 2 m before the centre
    assert [o.id for o in see(0, errors(obstacle_range_m=78.1))] == [1, 2]
    unknown = VehicleState(0, *[np.nan] * 6)
    assert len(see(0, errors(obstacle_range_m=1.0), car=unknown)) == 2


@settings(max_examples=5)
@given(share=st.floats(0.05, 0.95), seed=st.integers(0, 2**31 - 1))
def test_obstacles_drop_out_for_their_share_of_the_time_each_on_its_own(share, seed):
    params = errors(obstacle_dropout=share, obstacle_dropout_s=0.2, seed=seed)
    seen = np.array(
        [
            [o.id in {p.id for p in see(k * TICK_NS, params)} for o in WORLD.items]
            for k in range(2000)
        ]
    )
    periods = seen.reshape(-1, 4, 2)
    assert np.all(periods == periods[:, :1])  # 0.2 s at a time
    assert 1 - np.mean(periods[:, 0], axis=0) == pytest.approx([share] * 2, abs=0.12)
    both = np.mean(~periods[:, 0, 0] & ~periods[:, 0, 1])
    assert both == pytest.approx(share**2, abs=0.12)


def test_the_controller_plans_from_what_it_measures(world):
    options = {'left_bias_m': 0.3, 'obstacle_range_m': 30.0}
    params, vehicle = world.load(**{f'measurement_errors__{k}': v for k, v in options.items()})
    controller = world.set_inputs(Controller(params, vehicle), world.lane_change())
    command, prediction, why = world.tick(controller, world.rolling(X=20.0, stamp_ns=TICK_NS))
    assert (prediction.X[0], prediction.Y[0]) == pytest.approx((20.0, 0.3))
    assert command.stamp_ns == why.stamp_ns == TICK_NS
    assert 'v2o.1' not in why.values  # 50 m ahead
    *_, why = world.tick(controller, world.rolling(X=45.0, stamp_ns=2 * TICK_NS))
    assert 'v2o.1' in why.values
