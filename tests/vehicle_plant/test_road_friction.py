"""Friction by patches: under which wheel, from where to where, and what the car does on it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msgs_yaml.types import WHEELS, Command
from node_runtime.parameters import ParameterError
from vehicle_plant import integrator, parameters, road_friction
from vehicle_plant.initial_state import Start, rolling_state
from vehicle_plant.parameters import FrictionPatchParams
from vehicle_plant.simulator import TICK_STEPS, Simulator
from vehicle_plant.state import join_trajectories

LEFT_HALF = [5.0, 0.0, 200.0, 0.0, 200.0, 10.0, 5.0, 10.0]
RIGHT_HALF = [5.0, 0.0, 5.0, -10.0, 200.0, -10.0, 200.0, 0.0]
SQUARE = [0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0]


def under_wheels(params, pose, patches, friction=1.0):
    x = rolling_state(params, Start(*pose, 10.0))
    p = integrator.parameter_vector(params, friction)
    return integrator.with_local_friction(x, p, patches)[-4:]


def brake(params, patches, friction=1.0, seconds=1.5):
    car = Simulator(params, friction, Start(0.0, 0.0, 0.0, 20.0), patches=patches)
    ticks = [
        car.advance(Command(car.stamp_ns, 0.0, 0.0, -5000.0, -3000.0), TICK_STEPS)
        for _ in range(round(seconds * 20))
    ]
    return join_trajectories(ticks)


def test_split_mu_braking_yaws_towards_the_high_mu_side(params):
    """The side with grip brakes more: ice on the left turns the car to the right."""
    ice_left = brake(params, road_friction.patch_array(LEFT_HALF, [0.2]))
    ice_right = brake(params, road_friction.patch_array(RIGHT_HALF, [0.2]))
    assert ice_left.column('planar.psi')[-1] < -0.02
    assert ice_right.column('planar.psi')[-1] > 0.02
    # the car is symmetric, and so is what it does
    assert np.allclose(ice_left.column('planar.psi'), -ice_right.column('planar.psi'), atol=1e-9)
    assert abs(brake(params, road_friction.patch_array([], [])).column('planar.psi')[-1]) < 1e-12


def test_safe_stop_on_split_mu_asks_for_what_the_slippery_side_holds(params):
    """No wheel locks, and the car stays straight without a hand on the wheel."""
    start = Start(20.0, 0.0, 0.0, 15.0)
    car = Simulator(params, 1.0, start, patches=road_friction.patch_array(LEFT_HALF, [0.3]))
    car.brake_straight()
    track = car.advance(None, 1500)
    stop = params.car.safe_stop
    forces = (-stop.front_brake_n, -stop.rear_brake_n)
    assert (car.actuators.Fxf, car.actuators.Fxr) == pytest.approx(tuple(0.3 * F for F in forces))
    vx = track.column('planar.vx')
    assert vx[-1] < 13.0
    for w in WHEELS:
        rolls = track.column(f'wheels.{w}.omega') * params.car.wheel.radius_m / vx
        assert rolls.min() > 0.9
    assert abs(track.column('planar.psi')).max() < 0.02


def test_safe_stop_counts_the_wheels_that_are_on_the_patch_now(params):
    stop = params.car.safe_stop
    for X, friction in ((0.0, 1.0), (4.5, 0.3)):  # the patch begins at 5 m
        begun = Start(X, 0.0, 0.0, 1.0)
        car = Simulator(params, 1.0, begun, patches=road_friction.patch_array(LEFT_HALF, [0.3]))
        car.brake_straight()
        car.advance(None, 400)
        assert car.actuators.Fxf == pytest.approx(-friction * stop.front_brake_n, rel=1e-3)


def test_force_on_ice_is_that_of_ice(params):
    track = brake(params, road_friction.patch_array(LEFT_HALF, [0.2]), seconds=1.0)
    for w, mu in (('fl', 0.2), ('rl', 0.2), ('fr', 1.0), ('rr', 1.0)):
        Fz = track.column(f'loads.{w}.Fz')[-1]
        use = np.hypot(*(track.column(f'loads.{w}.{n}')[-1] for n in ('Fx', 'Fy'))) / Fz
        assert use < 1.25 * mu
    left = track.column('loads.fl.Fx')[-1]
    assert abs(left) < 0.4 * abs(track.column('loads.fr.Fx')[-1])


def test_patch_everywhere_is_the_friction_of_the_road(params):
    everywhere = road_friction.patch_array([-1e3, -1e3, 1e3, -1e3, 1e3, 1e3, -1e3, 1e3], [0.6])
    a = brake(params, everywhere, friction=1.0)
    b = brake(params, None, friction=0.6)
    assert np.array_equal(a.rows, b.rows)


def test_no_patch_and_a_patch_elsewhere_change_no_bit(params):
    plain = brake(params, None).rows
    assert np.array_equal(plain, brake(params, road_friction.patch_array([], [])).rows)
    far = [c + 1e4 for c in SQUARE]
    assert np.array_equal(plain, brake(params, road_friction.patch_array(far, [0.1])).rows)


def test_wheels_meet_the_edge_one_after_the_other(params):
    """A patch from x = 5 m on: the front wheels are on it first, the rear a wheelbase later."""
    body = params.car.body
    both = road_friction.patch_array([5.0, -10.0, 200.0, -10.0, 200.0, 10.0, 5.0, 10.0], [0.3])
    front_edge, rear_edge = 5.0 - body.cog_to_front_m, 5.0 + body.cog_to_rear_m
    for X, expected in (
        (front_edge - 1e-6, [1.0, 1.0, 1.0, 1.0]),
        (front_edge + 1e-6, [0.3, 0.3, 1.0, 1.0]),
        (rear_edge - 1e-6, [0.3, 0.3, 1.0, 1.0]),
        (rear_edge + 1e-6, [0.3, 0.3, 0.3, 0.3]),
    ):
        assert under_wheels(params, (X, 0.0, 0.0), both).tolist() == expected


def test_wheels_are_where_heading_and_track_put_them(params):
    """Heading north, the left wheels are to the west."""
    west = road_friction.patch_array([-9.0, -9.0, 0.0, -9.0, 0.0, 9.0, -9.0, 9.0], [0.5])
    assert under_wheels(params, (0.0, 0.0, np.pi / 2), west).tolist() == [0.5, 1.0, 0.5, 1.0]
    half_track = params.car.suspension.front.track_m / 2
    X = half_track + 1e-6
    assert under_wheels(params, (X, 0.0, np.pi / 2), west).tolist() == [1.0, 1.0, 0.5, 1.0]


def test_edge_belongs_to_the_patch_and_the_last_patch_counts():
    def at(X, Y, corners, friction):
        patches = road_friction.pad_patches(road_friction.patch_array(corners, friction))
        return float(road_friction.friction_at(X, Y, 1.0, patches))

    assert at(0.0, 0.5, SQUARE, [0.3]) == 0.3
    assert at(1.0, 1.0, SQUARE, [0.3]) == 0.3
    assert at(np.nextafter(1.0, 2.0), 0.5, SQUARE, [0.3]) == 1.0
    assert at(0.5, 0.5, SQUARE + SQUARE, [0.3, 0.7]) == 0.7


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
    inside = abs(turns.sum()) > np.pi
    order = corners[::-1] if clockwise else corners
    patches = road_friction.pad_patches(road_friction.patch_array(order.ravel(), [0.3]))
    assert float(road_friction.friction_at(X, Y, 1.0, patches)) == (0.3 if inside else 1.0)


@pytest.mark.needs('compiler')
def test_compiled_and_interpreted_read_the_same_map(params, advance_interpreted):
    patches = road_friction.patch_array(LEFT_HALF + [4 + c for c in SQUARE], [0.3, 0.6])
    x = rolling_state(params, Start(3.0, 0.5, 0.1, 20.0))
    set_points = np.tile([0.02, -4000.0, -2000.0], (201, 1))
    p = integrator.parameter_vector(params, 0.9)
    fast = integrator.advance(x, set_points, p, patches=patches)[1]
    _, slow = advance_interpreted(x, set_points, p, patches)
    assert np.abs(fast - slow).max() <= 1e-9 * np.abs(fast).max()


def test_bursts_of_any_length_see_the_same_patches(params):
    patches = road_friction.patch_array(LEFT_HALF, [0.3])
    cars = [Simulator(params, 1.0, Start(3.0, 0.0, 0.0, 20.0), patches=patches) for _ in range(2)]
    command = Command(cars[0].stamp_ns, 0.02, 0.0, -3000.0, 0.0)
    whole = cars[0].advance(command, 200)
    pieces = [cars[1].advance(command, 50), *(cars[1].advance(None, n) for n in (1, 49, 100))]
    assert np.allclose(whole.rows, join_trajectories(pieces).rows, rtol=0, atol=1e-7)


def test_start_on_a_patch_reads_its_friction(params):
    patches = road_friction.patch_array([-9.0, -9.0, 9.0, -9.0, 9.0, 9.0, -9.0, 9.0], [0.4])
    on_patch = Simulator(params, 1.0, Start(0.0, 0.0, 0.0, 20.0), patches=patches).now.wheels()
    assert on_patch == Simulator(params, 0.4, Start(0.0, 0.0, 0.0, 20.0)).now.wheels()


@pytest.mark.parametrize(
    ('corners', 'friction', 'message'),
    [
        (SQUARE, [0.3, 0.4], 'corners_m has 8 numbers, 8 per friction are 16'),
        (SQUARE * 17, [0.3] * 17, '17 of them, allowed are 16'),
        (SQUARE, [0.0], 'friction of patch 0 is 0.0'),
        ([0, 0, 1, 0, 0, 1, 1, 1], [0.3], 'patch 0 is not a convex quadrilateral'),
        ([0, 0, 1, 0, 0.2, 0.2, 0, 1], [0.3], 'not a convex'),
        ([0, 0, 1, 0, 1, 0, 0, 1], [0.3], 'not a convex'),
        ([*SQUARE[:7], np.nan], [0.3], 'a corner of patch 0 is not finite'),
    ],
)
def test_map_that_makes_no_sense_is_refused(corners, friction, message):
    with pytest.raises(ValueError, match=message):
        road_friction.patch_array(corners, friction)
    with pytest.raises(ParameterError, match=message):
        road_friction.patches_from_parameters(FrictionPatchParams(tuple(corners), tuple(friction)))


def test_sixteen_patches_are_sixteen(params):
    strips = [[i, 0.0, i + 1.0, 0.0, i + 1.0, 4.0, float(i), 4.0] for i in range(16)]
    patches = road_friction.patch_array(np.ravel(strips), 0.1 + 0.05 * np.arange(16))
    front = params.car.body.cog_to_front_m
    for i in range(16):
        local = under_wheels(params, (i + 0.5 - front, 2.0, 0.0), patches)
        assert dict(zip(WHEELS, local))['fl'] == pytest.approx(0.1 + 0.05 * i, abs=1e-15)


def test_parameters_of_the_node_take_the_flat_arrays():
    assert len(road_friction.patches_from_parameters(FrictionPatchParams((), ()))) == 0
    assert road_friction.patches_from_parameters(
        FrictionPatchParams(tuple(SQUARE), (0.5,))
    ).shape == (1, 13)
    assert parameters.config_file(parameters.DEFAULT_CAR).is_file()
