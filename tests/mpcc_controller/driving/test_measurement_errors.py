"""What the controller measures: with the errors of its parameters, and the same ones again."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.driving import measurement_errors
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.measurement_errors import measured_obstacles, measured_state
from mpcc_controller.driving.records import unknown_state
from mpcc_controller.parameters import MeasurementErrors
from msgs_yaml.types import Obstacle, Obstacles, VehicleState

NONE = MeasurementErrors(
    **dict.fromkeys(field.name for field in dataclasses.fields(MeasurementErrors))
)
TICK_NS = 50_000_000
EGO = VehicleState(TICK_NS, 10.0, -2.0, 0.3, 20.0, 0.5, 0.2)
WORLD = Obstacles(
    TICK_NS, (Obstacle(1, 40.0, 0.0, 1.0, 0.0, 0.0), Obstacle(2, 90.0, 1.0, 2.0, 0.0, 0.0))
)


def errors(**values):
    return dataclasses.replace(NONE, **values)


def see(stamp_ns, params, ego=EGO):
    return measured_obstacles(WORLD, ego, stamp_ns, params).items


def test_without_errors_nothing_is_changed():
    assert measured_state(EGO, errors(seed=3)) is EGO
    assert measured_obstacles(WORLD, EGO, TICK_NS, errors(seed=3)) is WORLD


biases = st.floats(-0.3, 0.3)


@given(st.floats(-7.0, 7.0), biases, biases, biases, biases, biases)
def test_each_bias_has_its_meaning(psi, ahead, left, yaw, angle, share):
    """That of the position is in the frame of the car; the sideslip does not change the speed."""
    truth = EGO._replace(psi=psi)
    position = {'ahead_bias_m': ahead, 'left_bias_m': left, 'yaw_bias_rad': yaw}
    x = measured_state(truth, errors(**position, sideslip_bias_rad=angle, speed_error=share))
    offset = complex(x.X - truth.X, x.Y - truth.Y) * np.exp(-1j * psi)
    assert offset == pytest.approx(complex(ahead, left), abs=1e-9)
    velocity = (1 + share) * np.exp(1j * angle) * complex(EGO.vx, EGO.vy)
    assert complex(x.vx, x.vy) == pytest.approx(velocity)
    assert (x.psi - psi, x.r) == pytest.approx((yaw, EGO.r), abs=1e-9)


def test_the_noise_has_its_deviations_and_is_white():
    deviations = {
        'position_noise_m': 0.1,
        'yaw_noise_rad': 0.01,
        'speed_noise_mps': 0.3,
        'lateral_speed_noise_mps': 0.2,
        'yaw_rate_noise_radps': 0.02,
    }
    params, truth = errors(seed=5, **deviations), EGO._replace(psi=0.0)
    states = [measured_state(truth._replace(stamp_ns=k * TICK_NS), params) for k in range(2000)]
    noise = (np.array(states) - truth)[:, 1:] / (0.1, 0.1, 0.01, 0.3, 0.2, 0.02)
    assert np.mean(noise, axis=0) == pytest.approx(np.zeros(6), abs=0.1)
    assert np.cov(noise.T) == pytest.approx(np.eye(6), abs=0.13)
    assert np.mean(noise[1:] * noise[:-1], axis=0) == pytest.approx(np.zeros(6), abs=0.1)


def test_the_errors_of_a_stamp_are_always_the_same_and_of_a_seed_its_own():
    first, again, other = (
        errors(seed=seed, speed_noise_mps=0.3, obstacle_noise_m=0.2) for seed in (1, 1, 2)
    )
    assert measured_state(EGO, first) == measured_state(EGO, again) != measured_state(EGO, other)
    assert see(7, first) == see(7, again) != see(7, other)


def test_obstacles_beyond_the_range_are_not_seen():
    assert [o.id for o in see(0, errors(obstacle_range_m=50.0))] == [1]
    # the range ends at the surface, 2 m before the centre
    assert [o.id for o in see(0, errors(obstacle_range_m=78.1))] == [1, 2]
    unknown = unknown_state(0)
    assert len(see(0, errors(obstacle_range_m=1.0), unknown)) == 2


@settings(max_examples=3)
@given(share=st.floats(0.05, 0.95), seed=st.integers(0, 2**31 - 1))
def test_obstacles_drop_out_for_their_share_of_the_time_each_on_its_own(share, seed):
    params = errors(obstacle_dropout=share, obstacle_dropout_s=0.1, seed=seed)
    ids = [{o.id for o in see(k * TICK_NS, params)} for k in range(800)]
    periods = np.array([[key in seen for key in (1, 2)] for seen in ids]).reshape(-1, 2, 2)
    assert np.all(periods == periods[:, :1])  # 0.1 s at a time
    gone = ~periods[:, 0]
    assert np.mean(gone, axis=0) == pytest.approx([share] * 2, abs=0.15)
    assert np.mean(np.all(gone, axis=1)) == pytest.approx(share**2, abs=0.15)


LONE = Obstacles(TICK_NS, (Obstacle(1, 40.0, 0.0, 1.0, -8.0, 3.0),))
GHOSTS = measurement_errors.GHOST_IDS


def seen_over_time(params, count):
    """Return the obstacles that are seen of a lone one in each of so many ticks."""
    stamps = TICK_NS * np.arange(1, count + 1)
    return [measured_obstacles(LONE, EGO, int(stamp), params).items for stamp in stamps]


@pytest.mark.parametrize(
    ('preset', 'position', 'velocity'),
    [('tracker', 0.2, 0.5), ('lidar', 0.288 / 1.2533, 0.216 / 1.2533), ('camera', 0.62, 0.69)],
)
def test_a_preset_has_the_errors_of_its_source(preset, position, velocity):
    ticks = seen_over_time(errors(preset=preset, seed=4), 2000)
    real = [o for items in ticks for o in items if o.id == 1]
    assert len(real) / len(ticks) == pytest.approx(0.95, abs=0.015)
    error = np.array([(o.X - 40.0, o.Y, o.vX + 8.0, o.vY - 3.0) for o in real])
    assert np.mean(error, axis=0) == pytest.approx(np.zeros(4), abs=0.04)
    sizes = [position, position, velocity, velocity]
    assert np.std(error, axis=0) == pytest.approx(sizes, rel=0.05)
    assert np.corrcoef(error.T) == pytest.approx(np.eye(4), abs=0.07)
    # a ghost lasts for 6 ticks, of which each misses 5 %
    ghosts = np.array([any(o.id >= GHOSTS for o in items) for items in ticks])
    assert np.mean(ghosts) == pytest.approx(0.05 * 0.95, abs=0.025)
    assert measured_state(EGO, errors(preset=preset)) is EGO


def test_what_is_given_wins_over_a_preset():
    params = errors(preset='tracker', obstacle_noise_m=0.0, obstacle_dropout=0.0)
    params = dataclasses.replace(params, obstacle_velocity_noise_mps=0.0, obstacle_ghosts=0.0)
    assert see(TICK_NS, params) == WORLD.items


def test_a_latency_shows_obstacles_where_they_were():
    ((moved,),) = seen_over_time(errors(obstacle_latency_s=0.25), 1)
    assert moved == LONE.items[0]._replace(X=42.0, Y=-0.75)


def test_a_ghost_stands_ahead_while_the_car_drives_on_and_all_are_told_apart():
    params, first = errors(obstacle_ghosts=0.5, seed=2), {}
    for k in range(400):
        at = complex(EGO.X, EGO.Y) + 0.05 * k * complex(EGO.vx, EGO.vy) * np.exp(1j * EGO.psi)
        car, nothing = EGO._replace(X=at.real, Y=at.imag), Obstacles(TICK_NS * k, ())
        for ghost in measured_obstacles(nothing, car, TICK_NS * k, params).items:
            place = complex(ghost.X, ghost.Y)
            if ghost.id not in first:
                away = (place - at) * np.exp(-1j * car.psi)
                assert 4.0 <= away.real <= 60.0
                assert abs(away.imag) <= 6.1
            assert place == pytest.approx(first.setdefault(ghost.id, place), abs=1e-6)
            assert ghost.id == GHOSTS + TICK_NS * k // 300_000_000
    assert len(first) == pytest.approx(0.5 * 400 / 6, abs=15)
    assert measured_obstacles(WORLD, unknown_state(0), 0, params) == WORLD


def test_the_two_that_are_closest_exchange_their_ids_for_a_share_of_the_time():
    three = Obstacles(0, (*WORLD.items, Obstacle(3, 92.0, 2.0, 0.5, 0.0, 0.0)))
    params, swapped = errors(obstacle_swaps=0.3, seed=9), []
    for k in range(2000):
        seen = measured_obstacles(three, EGO, TICK_NS * k, params).items
        assert seen[0] == three.items[0]
        swapped.append([o.id for o in seen] == [1, 3, 2])
        assert [o._replace(id=0) for o in seen] == [o._replace(id=0) for o in three.items]
    periods = np.reshape(swapped, (-1, 10))  # 0.5 s each
    assert np.all(periods == periods[:, :1])
    assert np.mean(swapped) == pytest.approx(0.3, abs=0.1)


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
