"""Friction by patches: under which wheel, from where to where, and what the car does on it."""

import numpy as np
import pytest
from drives import altered, drive
from hypothesis import given, settings
from hypothesis import strategies as st

from msgs_yaml.types import WHEELS
from node_runtime.parameters import ParameterError
from vehicle_plant import integrator, road_friction
from vehicle_plant.initial_state import Start, rolling_state
from vehicle_plant.simulator import Simulator

SQUARE = [0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0]


def rectangle(left, bottom, right, top, friction):
    corners = [left, bottom, right, bottom, right, top, left, top]
    return road_friction.patch_array(corners, [friction])


def left_half(friction):
    return rectangle(5.0, 0.0, 200.0, 10.0, friction)


def under_wheels(params, pose, patches):
    x = rolling_state(params, Start(*pose, 10.0))
    return integrator.with_local_friction(x, integrator.parameter_vector(params, 1.0), patches)[-4:]


def brake(patches=None, friction=1.0):
    return drive(lambda t, car: (0.0, -5000.0, -3000.0), 1.0, patches=patches, friction=friction)


def test_split_mu_braking_yaws_towards_the_high_mu_side():
    """The side with grip brakes more, each wheel by its own friction; the car is symmetric."""
    ice_left, ice_right = brake(left_half(0.2)), brake(rectangle(5.0, -10.0, 200.0, 0.0, 0.2))
    psi = ice_left.column('planar.psi')
    assert psi[-1] < -0.01
    assert np.allclose(psi, -ice_right.column('planar.psi'), atol=1e-9)
    for w in WHEELS:
        Fx, Fy, Fz = (ice_left.column(f'loads.{w}.{n}')[-1] for n in ('Fx', 'Fy', 'Fz'))
        assert np.hypot(Fx, Fy) / Fz < 1.25 * (0.2 if w[1] == 'l' else 1.0)
    left, right = (ice_left.column(f'loads.f{side}.Fx')[-1] for side in 'lr')
    assert abs(left) < 0.4 * abs(right)


def test_a_patch_everywhere_is_the_friction_of_the_road_and_one_elsewhere_changes_no_bit():
    everywhere = rectangle(-1e3, -1e3, 1e3, 1e3, 0.6)
    assert np.array_equal(brake(everywhere).rows, brake(friction=0.6).rows)
    plain = brake().rows
    assert np.array_equal(plain, brake(road_friction.patch_array([], [])).rows)
    assert np.array_equal(plain, brake(rectangle(1e4, 0.0, 1e4 + 1, 1.0, 0.1)).rows)


def test_safe_stop_on_split_mu_asks_for_what_the_slippery_side_holds(params):
    """No wheel locks, and the car stays straight without a hand on the wheel."""
    car = Simulator(params, 1.0, Start(20.0, 0.0, 0.0, 15.0), patches=left_half(0.3))
    car.brake_straight()
    track, stop = car.advance(None, 1500), params.car.safe_stop
    asked = (car.actuators.Fxf, car.actuators.Fxr)
    assert asked == pytest.approx((-0.3 * stop.front_brake_n, -0.3 * stop.rear_brake_n))
    vx = track.column('planar.vx')
    assert vx[-1] < 13.0
    for w in WHEELS:
        rolls = track.column(f'wheels.{w}.omega') * params.car.wheel.radius_m / vx
        assert rolls.min() > 0.9
    assert abs(track.column('planar.psi')).max() < 0.02


@pytest.mark.parametrize(('X', 'friction'), [(0.0, 1.0), (4.5, 0.3)])
def test_safe_stop_counts_the_wheels_that_are_on_the_patch_now(params, X, friction):
    """The patch begins at 5 m."""
    car = Simulator(params, 1.0, Start(X, 0.0, 0.0, 1.0), patches=left_half(0.3))
    car.brake_straight()
    car.advance(None, 400)
    expected = -friction * params.car.safe_stop.front_brake_n
    assert car.actuators.Fxf == pytest.approx(expected, rel=1e-3)


def test_wheels_meet_the_edge_one_after_the_other_where_heading_and_track_put_them(params):
    """Heading north, the left wheels are to the west; a wheelbase lies between front and rear."""
    body, front = params.car.body, params.car.suspension.front
    ahead, west = rectangle(5.0, -10.0, 200.0, 10.0, 0.3), rectangle(-9.0, -9.0, 0.0, 9.0, 0.3)
    front_edge, rear_edge = 5.0 - body.cog_to_front_m, 5.0 + body.cog_to_rear_m
    on = {True: 0.3, False: 1.0}
    for X, fronts, rears in (
        (front_edge - 1e-6, False, False),
        (front_edge + 1e-6, True, False),
        (rear_edge - 1e-6, True, False),
        (rear_edge + 1e-6, True, True),
    ):
        expected = [on[fronts]] * 2 + [on[rears]] * 2
        assert under_wheels(params, (X, 0.0, 0.0), ahead).tolist() == expected
    wide = altered(params, car__suspension__rear__track_m=front.track_m + 0.02)
    north = np.pi / 2
    assert under_wheels(wide, (0.0, 0.0, north), west).tolist() == [0.3, 1.0, 0.3, 1.0]
    beyond = front.track_m / 2 + 1e-6
    assert under_wheels(wide, (beyond, 0.0, north), west).tolist() == [1.0, 1.0, 0.3, 1.0]


def friction_at(X, Y, corners, friction, road=1.0):
    patches = road_friction.pad_patches(road_friction.patch_array(corners, friction))
    return float(road_friction.friction_at(X, Y, road, patches))


def test_edge_belongs_to_the_patch_and_the_last_patch_counts():
    assert friction_at(0.0, 0.5, SQUARE, [0.3]) == 0.3
    assert friction_at(1.0, 1.0, SQUARE, [0.3]) == 0.3
    assert friction_at(np.nextafter(1.0, 2.0), 0.5, SQUARE, [0.3]) == 1.0
    assert friction_at(0.5, 0.5, SQUARE + SQUARE, [0.3, 0.7]) == 0.7


@settings(max_examples=60)
@given(
    st.lists(st.floats(0.05, 6.2), min_size=4, max_size=4, unique=True),
    st.floats(-5.0, 5.0),
    st.floats(-5.0, 5.0),
    st.booleans(),
)
def test_inside_is_what_the_angles_around_a_point_say(angles, X, Y, clockwise):
    """Against the winding number: corners on an ellipse, in either direction."""
    angles = np.sort(angles)
    if np.diff(angles).min() < 0.02:
        return
    corners = np.column_stack([4.0 * np.cos(angles), 2.0 * np.sin(angles)])
    around = np.arctan2(corners[:, 1] - Y, corners[:, 0] - X)
    turns = (np.diff(np.append(around, around[0])) + np.pi) % (2 * np.pi) - np.pi
    if np.abs(np.abs(turns) - np.pi).min() < 1e-6:  # on an edge, to rounding
        return
    order = corners[::-1] if clockwise else corners
    expected = 0.3 if abs(turns.sum()) > np.pi else 1.0
    assert friction_at(X, Y, order.ravel(), [0.3]) == expected


def test_sixteen_patches_are_sixteen(params):
    strips = [[i, 0.0, i + 1.0, 0.0, i + 1.0, 4.0, float(i), 4.0] for i in range(16)]
    patches = road_friction.patch_array(np.ravel(strips), 0.1 + 0.05 * np.arange(16))
    front = params.car.body.cog_to_front_m
    for i in range(16):
        local = under_wheels(params, (i + 0.5 - front, 2.0, 0.0), patches)
        assert local[0] == pytest.approx(0.1 + 0.05 * i, abs=1e-15)


@pytest.mark.parametrize(
    ('corners', 'friction', 'message'),
    [
        (SQUARE, [0.3, 0.4], 'corners_m has 8 numbers, 8 per friction are 16'),
        (SQUARE * 17, [0.3] * 17, '17 of them, allowed are 16'),
        (SQUARE, [0.0], 'friction of patch 0 is 0.0'),
        (SQUARE * 2, [0.3, np.inf], 'friction of patch 1 is inf'),
        ([0, 0, 1, 0, 0, 1, 1, 1], [0.3], 'patch 0 is not a convex quadrilateral'),
        ([0, 0, 1, 0, 0.2, 0.2, 0, 1], [0.3], 'not a convex'),
        ([0, 0, 1, 0, 1, 0, 0, 1], [0.3], 'not a convex'),
        ([*SQUARE[:7], np.nan], [0.3], 'a corner of patch 0 is not finite'),
    ],
)
def test_map_that_makes_no_sense_is_refused(corners, friction, message):
    with pytest.raises(ParameterError, match=f'patches: .*{message}'):
        road_friction.patch_array(corners, friction)
