"""Initial guesses around obstacles: where they lead, and that they are drivable motions."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mpcc_controller import car_file
from mpcc_controller.driving import (
    braking,
    choose,
    guesses,
    ways,
)
from mpcc_controller.driving.setpoints import Setpoints, command_to, setpoints_of
from mpcc_controller.driving.ways import BEHIND, LEFT, RIGHT
from mpcc_controller.model.single_track import State
from mpcc_controller.path import reference_path, road_edges
from mpcc_controller.problem import stage_parameters
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.types import Obstacle
from vehicle_plant import parameters as plant_parameters
from vehicle_plant.initial_state import Start
from vehicle_plant.simulator import Simulator

GRAVITY = 9.81
R_VEH = 1.1  # m, of mpcc.yaml
STEP_S = 0.05
# nothing here compiles or solves; the first example loads CasADi
quick = settings(max_examples=60)


@pytest.fixture(scope='module')
def params(world):
    return world.load(candidates__most=4)[0]


@pytest.fixture(scope='module')
def car(params, vehicle):
    return stage_parameters.car(params, vehicle)


def scene_of(world, obstacles, v=20.0, left=6.0, right=-6.0):
    situation = world.straight(v, obstacles, left, right)
    return Scene(
        reference_path.build(situation.reference),
        road_edges.build(situation.edges),
        situation.obstacles,
    )


def start(v=20.0, X=0.0, Y=0.0, psi=0.0):
    return State(X, Y, psi, v, 0.0, 0.0, X, 0.0, 0.0)


def standing(key, X, Y, r_obs=1.0):
    return Obstacle(key, X, Y, r_obs, 0.0, 0.0)


def all_guesses(scene, x0, car, params):
    """Return (sides, profile, guess) of every way around what is dangerous."""
    around = ways.road_ahead(scene, x0, (), car, params)
    found = ways.side_combinations(around, x0, params)
    return [(*way, guesses.along_profile(around, way[1], x0, car, params)) for way in found]


@quick
@given(
    v=st.floats(8.0, 30.0),
    seconds=st.floats(0.8, 2.0),
    Y=st.floats(-1.5, 1.5),
    r_obs=st.floats(0.3, 1.5),
)
def test_a_guess_passes_the_obstacle_on_its_side_on_the_road_without_contact(
    world, params, car, v, seconds, Y, r_obs
):
    scene = scene_of(world, [standing(1, v * seconds + 3, Y, r_obs)], v)
    x0 = start(v)
    found = all_guesses(scene, x0, car, params)
    assert found
    for sides, shape, guess in found:
        x = State(*guess.X.T)
        assert tuple(guess.X[0]) == x0
        assert ways.passed_sides(guess.X, scene, scene.obstacles.items, params) == sides
        assert np.all(np.abs(x.Y) <= 6.0 - R_VEH + 1e-9)
        # a quintic that begins at once: what it does not reach, no guess of this form reaches
        if shape.acceleration < GRAVITY:
            assert ways.least_gaps(guess.X, scene, params)[0] > -1e-6


@quick
@given(
    v=st.floats(10.0, 30.0),
    seconds=st.floats(1.0, 2.0),
    Y=st.floats(-1.0, 1.0),
    Y0=st.floats(-1.0, 1.0),
)
def test_a_guess_is_a_motion(world, params, car, v, seconds, Y, Y0):
    """Positions move with the velocity, and the course turns as its lateral acceleration says."""
    scene = scene_of(world, [standing(1, v * seconds, Y)], v)
    for _, shape, guess in all_guesses(scene, start(v, Y=Y0), car, params):
        if shape.acceleration > 6.0:  # beyond steady cornering
            continue
        x = State(*guess.X[1:].T)  # stage 0 is measured
        course = x.psi + np.arctan2(x.vy, x.vx)
        moved = np.diff(np.column_stack([x.X, x.Y]), axis=0) / STEP_S
        # ahead and aside of the course, in between two stages
        mean = (course[1:] + course[:-1]) / 2
        ahead = np.cos(mean) * moved[:, 0] + np.sin(mean) * moved[:, 1]
        aside = np.cos(mean) * moved[:, 1] - np.sin(mean) * moved[:, 0]
        assert np.max(np.abs(aside)) < 0.05 * v  # 3 deg
        # a car that moves aside is longer under way; its guess is not slower for that
        assert np.all(ahead > 0.98 * x.vx[1:])
        assert np.all(ahead < 1.1 * x.vx[1:])
        turned = np.diff(course) / STEP_S
        assert np.max(np.abs(turned - (x.r[1:] + x.r[:-1]) / 2)) < 0.5 * GRAVITY / v


@quick
@given(v=st.floats(10.0, 30.0), seconds=st.floats(0.8, 2.0), Y=st.floats(-1.5, 1.5))
def test_a_mirrored_road_has_mirrored_guesses(world, params, car, v, seconds, Y):
    def all_of(sign):
        scene = scene_of(world, [standing(1, v * seconds, sign * Y)], v)
        return {
            way[0][1] * sign: way[2].X[:, 1] * sign
            for way in all_guesses(scene, start(v), car, params)
        }

    one, mirrored = all_of(1), all_of(-1)
    assert one.keys() == mirrored.keys() == {LEFT, RIGHT}
    for side, Y_of in one.items():
        assert mirrored[side] == pytest.approx(Y_of, abs=1e-9)


@quick
@given(v=st.floats(10.0, 28.0), oncoming=st.floats(3.0, 20.0), seconds=st.floats(0.8, 2.0))
def test_an_oncoming_car_is_met_where_both_speeds_say(world, params, car, v, oncoming, seconds):
    gap = (v + oncoming) * seconds
    scene = scene_of(world, [Obstacle(1, gap, 0.0, 1.0, -oncoming, 0.0)], v)
    (hazard,) = ways.road_ahead(scene, start(v), (), car, params).hazards
    touch = (1.0 + R_VEH) / (v + oncoming)
    assert hazard.enter == pytest.approx(seconds - touch, abs=1.01 * STEP_S)
    assert hazard.leave == pytest.approx(seconds + touch, abs=1.01 * STEP_S)


def test_a_slower_car_is_met_later_than_one_that_stands(world, params, car):
    def enter(vX):
        scene = scene_of(world, [Obstacle(1, 25.0, 0.0, 1.0, vX, 0.0)])
        return ways.road_ahead(scene, start(), (), car, params).hazards[0].enter

    assert enter(0.0) == pytest.approx((25 - 2.1) / 20, abs=STEP_S)
    assert enter(8.0) == pytest.approx((25 - 2.1) / 12, abs=STEP_S)


def test_a_car_behind_a_slow_one_accelerates_in_its_guess_past_it(world, params, car):
    scene = scene_of(world, [Obstacle(1, 4.0, 0.0, 1.0, 7.0, 0.0)], v=25.0)
    for _, _, guess in all_guesses(scene, start(7.5), car, params):
        assert State(*guess.X.T).vx[-1] > 14.0


@pytest.mark.parametrize('Y', [-6.0, 5.0, 40.0])
def test_an_obstacle_beside_the_way_is_no_danger(world, params, car, Y):
    scene = scene_of(world, [standing(1, 30.0, Y)])
    assert ways.road_ahead(scene, start(), (), car, params) is None


def test_an_obstacle_on_a_plan_is_a_danger_though_it_is_not_on_the_path(world, params, car):
    scene = scene_of(world, [standing(1, 30.0, 5.0)])
    plan = np.zeros((51, 9))
    plan[:, 0] = plan[:, 6] = np.arange(51.0)
    plan[:, 1] = 4.0
    around = ways.road_ahead(scene, start(), (plan,), car, params)
    assert [h.obstacle.id for h in around.hazards] == [1]


@quick
@given(gap=st.floats(0.0, 4.0))
def test_between_two_obstacles_there_is_a_way_where_the_circle_fits(world, params, car, gap):
    assume(abs(gap - 2 * R_VEH) > 1e-6)
    pair = [standing(1, 30.0, 1 + gap / 2), standing(2, 30.0, -1 - gap / 2)]
    sides = [way[0] for way in all_guesses(scene_of(world, pair), start(), car, params)]
    between = {1: RIGHT, 2: LEFT}
    assert (between in sides) == (gap > 2 * R_VEH)
    assert {1: LEFT, 2: RIGHT} not in sides  # on both sides at once


def test_beside_a_narrow_road_there_is_no_way(world, params, car):
    scene = scene_of(world, [standing(1, 30.0, 0.0)], left=3.0, right=-3.0)
    assert all_guesses(scene, start(), car, params) == []


def test_obstacles_in_turn_have_every_combination_the_easiest_first(world, params, car):
    pair = [standing(1, 25.0, 2.0), standing(2, 48.0, -2.0)]
    found = all_guesses(scene_of(world, pair), start(), car, params)
    assert sorted(tuple(way[0].values()) for way in found) == [(-1, -1), (-1, 1), (1, -1), (1, 1)]
    assert found[0][0] == {1: RIGHT, 2: LEFT}
    peaks = [way[1].acceleration for way in found]
    assert peaks == sorted(peaks)


def straight_line(v):
    """Return states (51, 9) that go straight on."""
    line = np.zeros((51, 9))
    line[:, 0] = line[:, 6] = v * STEP_S * np.arange(51)
    line[:, 3] = v
    return line


@quick
@given(v=st.floats(9.0, 35.0), Fx=st.floats(-15e3, 3e3))
def test_the_braking_guess_builds_up_its_force_and_stops_as_friction_allows(params, car, v, Fx):
    x0 = start(v)._replace(Fx=Fx)
    x = State(*guesses.braking(straight_line(v), x0, car, params).X.T)
    limits = params.limits
    hardest = limits.friction_use * min(car.mu_f, car.mu_r) * GRAVITY
    assert x.vx.min() >= limits.least_speed_mps - 1e-9
    above = x.vx > limits.least_speed_mps
    deceleration = -np.diff(x.vx)[above[1:]] / STEP_S
    assert np.max(deceleration, initial=0.0) <= hardest + 1e-9
    t = STEP_S * (np.arange(len(deceleration)) + 0.5)
    reached = np.maximum(-Fx, 0.0) + limits.force_rate_nps * t
    assert np.all(deceleration <= reached / car.m + 1e-9)
    late = t > STEP_S + (max(Fx, 0.0) + car.m * hardest) / limits.force_rate_nps
    assert deceleration[late] == pytest.approx(hardest)


@pytest.mark.parametrize('v', [15.0, 25.0, 35.0])
def test_a_car_stops_where_the_braking_guess_promises(world, v):
    """On the plant, by the law that brakes without a plan, from no force on a dry road."""
    params, _ = world.load('mpcc_road')
    plant = Simulator(plant_parameters.load(), 1.0, Start(0.0, 0.0, 0.0, v, 0.0, 0.0))
    car = stage_parameters.car(params, car_file.load(params))
    line = np.zeros((121, 9))
    line[:, 0] = line[:, 6] = v * STEP_S * np.arange(121)
    promised = guesses.braking(line, start(v), car, params, floor=0.0).X[-1, 0]
    now = Setpoints(0.0, 0.0)
    while plant.state.vx > 0.1:
        x = plant.state
        target = braking.braking_target(x, now, braking.Point(x.X + 20.0, 0.0), car, params)
        command = command_to(target, now, car, STEP_S, x.stamp_ns)
        now = setpoints_of(command, car)[0]
        plant.advance(command, 50)
    assert 0.95 * promised < plant.state.X < promised + 1.0


@quick
@given(v=st.floats(10.0, 30.0), kappa=st.floats(0.002, 0.02))
def test_the_braking_guess_keeps_to_a_bend_and_leaves_it_its_friction(params, car, v, kappa):
    available = params.limits.friction_use * min(car.mu_f, car.mu_r) * GRAVITY
    assume(v**2 * kappa < 0.75 * available)
    s = v * STEP_S * np.arange(51)
    line = np.column_stack([np.zeros((51, 9))])
    line[:, 0], line[:, 1] = np.sin(kappa * s) / kappa, (1 - np.cos(kappa * s)) / kappa
    line[:, 2], line[:, 3], line[:, 5], line[:, 6] = kappa * s, v, v * kappa, s
    x = State(*guesses.braking(line, start(v), car, params).X.T)
    # chords of a quarter of a metre to 1.5 m beside the arc
    assert np.max(np.abs(np.hypot(x.X, x.Y - 1 / kappa) - 1 / kappa)) < 0.01
    ax = np.max(-np.diff(x.vx)) / STEP_S
    assert math.hypot(ax, v**2 * kappa) == pytest.approx(available, rel=1e-6)


def test_a_plan_that_stays_behind_passes_on_no_side(world, params):
    scene = scene_of(world, [standing(1, 40.0, 0.5)])
    plan = np.zeros((51, 9))
    plan[:, 0] = plan[:, 6] = np.linspace(0, 30.0, 51)
    assert ways.passed_sides(plan, scene, scene.obstacles.items, params) == {1: BEHIND}
    assert ways.name_of({1: LEFT, 4: RIGHT, 5: BEHIND}) == 'left of 1, right of 4, behind of 5'


def test_a_plan_that_is_beside_an_obstacle_only_at_its_end_has_not_passed_it(world, params):
    scene = scene_of(world, [standing(1, 50.0, -2.5)])
    plan = np.zeros((51, 9))
    for end, side in ((48.5, BEHIND), (50.0, LEFT), (51.5, LEFT)):
        plan[:, 0] = plan[:, 6] = np.linspace(0.0, end, 51)
        assert ways.passed_sides(plan, scene, scene.obstacles.items, params) == {1: side}


@pytest.mark.parametrize(('v', 'desired'), [(2.0, 14.0), (0.0, 25.0), (13.0, 14.0), (20.0, 14.0)])
def test_regaining_the_speed_costs_what_its_errors_sum_up_to(world, params, car, v, desired):
    """The reference sums the cost of the velocity tick by tick at the largest driving force."""
    plan = np.zeros((51, 9))
    plan[:, 3] = v
    cost = choose.regaining_cost(plan, scene_of(world, [], desired), car, params)
    acceleration, expected = params.limits.drive_n / car.m, 0.0
    for t in np.arange(0.5 * STEP_S, 20.0, STEP_S):
        lacking = max(desired - v - acceleration * t, 0.0)
        expected += (lacking / params.tolerances.velocity_mps) ** 2
    assert cost == pytest.approx(expected, rel=0.01, abs=0.01)


@pytest.mark.parametrize('v', [2.0, 20.0])
def test_a_car_that_cannot_drive_regains_nothing_with_any_plan(world, params, car, v):
    coasting = dataclasses.replace(params, limits=dataclasses.replace(params.limits, drive_n=0.0))
    plan = np.zeros((51, 9))
    plan[:, 3] = v
    assert choose.regaining_cost(plan, scene_of(world, [], 14.0), car, coasting) == 0.0


def test_the_contact_speed_is_that_of_both_cars(world, params):
    def speed_at_contact(obstacle):
        plan = np.zeros((51, 9))
        plan[:, 0], plan[:, 3] = 20.0 * STEP_S * np.arange(51), 20.0
        return ways.contact_speed(plan, scene_of(world, [obstacle]), params)

    assert speed_at_contact(standing(1, 30.0, 0.0)) == pytest.approx(20.0)
    assert speed_at_contact(Obstacle(1, 60.0, 0.0, 1.0, -15.0, 0.0)) == pytest.approx(35.0)
    assert speed_at_contact(Obstacle(1, 20.0, 0.0, 1.0, 8.0, 0.0)) == pytest.approx(12.0)
    assert speed_at_contact(standing(1, 30.0, 3.0)) == 0.0
    assert speed_at_contact(standing(1, 70.0, 0.0)) == 0.0  # beyond the horizon


@quick
@given(v=st.floats(3.0, 30.0), Y=st.floats(-1.0, 1.0))
def test_a_plan_to_a_stop_stands_where_its_speed_is_zero(world, params, car, v, Y):
    x0 = start(v, Y=Y)
    line = np.tile(np.array(x0), (params.model.horizon + 1, 1))
    line[:, 0] = np.linspace(0.0, 2.0 * v, len(line))
    line[:, 6] = line[:, 0]
    stop = State(*guesses.braking(line, x0, car, params, floor=0.0).X.T)
    moved = np.hypot(np.diff(stop.X), np.diff(stop.Y)) / STEP_S
    mean = (stop.vx[1:] + stop.vx[:-1]) / 2
    assert moved == pytest.approx(mean, abs=0.02 * v)
    stands = stop.vx < 1e-9
    assert np.any(stands) or v > 16.0  # 2.5 s of 0.95 x 0.88 x 9.81 m/s^2, less the build-up
    assert np.all(np.abs(np.array([stop.vy, stop.r])[:, stands]) < 1e-9)
