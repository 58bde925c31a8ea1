"""Ways around obstacles and the guesses of them: where they lead, and that cars can drive so."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mpcc_controller import car_file
from mpcc_controller.driving import braking, choose, guesses, ways
from mpcc_controller.driving.setpoints import Setpoints, command_to, setpoints_of
from mpcc_controller.driving.ways import BEHIND, LEFT, RIGHT
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import State
from mpcc_controller.path import reference_path
from mpcc_controller.problem import stage_parameters
from mpcc_controller.problem.obstacle_motion import PredictedObstacle
from stage_solver.stage_problem import Plan, shift
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


@pytest.fixture(scope='module')
def road(world):
    """Return a function that returns a straight road with obstacles."""

    def scene(*obstacles, v=20.0, half_width=6.0):
        return world.scene(world.straight(v, obstacles, half_width, -half_width))

    return scene


def start(v=20.0, Y=0.0):
    return State(0.0, Y, 0.0, v, 0.0, 0.0, 0.0, 0.0, 0.0)


def standing(key, X, Y, r_obs=1.0):
    return PredictedObstacle(key, X, Y, r_obs, 0.0, 0.0)


def straight_line(length, v=0.0, Y=0.0, stages=51):
    """Return planned states (stages, 9) that go straight on."""
    line = np.zeros((stages, 9))
    line[:, 0] = line[:, 6] = np.linspace(0.0, length, stages)
    line[:, 1], line[:, 3] = Y, v
    return line


def all_guesses(scene, x0, car, params):
    """Return (sides, profile, guess) of every way around what is dangerous."""
    around = ways.road_ahead(scene, x0, (), car, params)
    combinations = ways.side_combinations(around, x0, params)
    return [(*way, guesses.along_profile(around, way[1], x0, car, params)) for way in combinations]


def test_an_object_of_several_discs_is_passed_on_one_side_as_far_as_it_reaches(road, car, params):
    lorry = [standing(4, X, Y) for X, Y in ((30.0, -1.0), (34.0, -1.0), (38.0, 0.5))]
    scene, discs = road(*lorry), road(*(disc._replace(id=k) for k, disc in enumerate(lorry)))
    around = ways.road_ahead(scene, start(), (), car, params)
    apart = ways.road_ahead(discs, start(), (), car, params).hazards
    (met,) = around.hazards
    assert (met.enter, met.leave) == (min(h.enter for h in apart), max(h.leave for h in apart))
    assert (met.lowest, met.highest) == (-1.0, 0.5)
    sides = [sides for sides, _ in ways.side_combinations(around, start(), params)]
    assert sides == [{4: LEFT}, {4: RIGHT}]
    line = straight_line(50.0, 20.0, Y=3.0)
    assert ways.passed_sides(line, scene, range(3), params) == {4: LEFT}


@quick
@given(
    v=st.floats(8.0, 30.0),
    seconds=st.floats(0.8, 2.0),
    Y=st.floats(-1.5, 1.5),
    r_obs=st.floats(0.3, 1.5),
)
def test_a_guess_passes_the_obstacle_on_its_side_on_the_road_and_a_mirrored_road_mirrors_it(
    road, params, car, v, seconds, Y, r_obs
):
    def guesses_beside(Y):
        scene, x0, lines = road(standing(1, v * seconds + 3, Y, r_obs), v=v), start(v), {}
        for sides, shape, guess in all_guesses(scene, x0, car, params):
            assert tuple(guess.X[0]) == x0
            assert ways.passed_sides(guess.X, scene, [0], params) == sides
            assert np.all(np.abs(guess.X[:, 1]) <= 6.0 - R_VEH + 1e-9)
            # a quintic that begins at once: what it does not reach, no guess of this form reaches
            if shape.acceleration < GRAVITY:
                assert ways.least_gaps(guess.X, scene, params)[0] > -1e-6
            lines[sides[1]] = guess.X[:, 1]
        return lines

    here, mirrored = guesses_beside(Y), guesses_beside(-Y)
    assert here
    assert {-side for side in here} == mirrored.keys()
    for side, line in here.items():
        assert mirrored[-side] == pytest.approx(-line, abs=1e-9)


@quick
@given(
    v=st.floats(10.0, 30.0),
    seconds=st.floats(1.0, 2.0),
    Y=st.floats(-1.0, 1.0),
    Y0=st.floats(-1.0, 1.0),
)
def test_a_guess_is_a_motion(road, params, car, v, seconds, Y, Y0):
    """Positions move with the velocity, the course turns as the tyres push, which are linear."""
    scene = road(standing(1, v * seconds, Y), v=v)
    for _, shape, guess in all_guesses(scene, start(v, Y0), car, params):
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
        Fy = car.m * x.vx * x.r / (car.l_f + car.l_r)
        front, rear = x.delta - (x.vy + car.l_f * x.r) / x.vx, (car.l_r * x.r - x.vy) / x.vx
        assert car.C_f * front == pytest.approx(car.l_r * Fy, abs=1.0)
        assert car.C_r * rear == pytest.approx(car.l_f * Fy, abs=1.0)
        turned = np.diff(course) / STEP_S
        assert np.max(np.abs(turned - (x.r[1:] + x.r[:-1]) / 2)) < 0.5 * GRAVITY / v


@quick
@given(v=st.floats(10.0, 28.0), other=st.floats(-20.0, 8.0), seconds=st.floats(0.8, 2.0))
def test_another_car_is_met_when_both_speeds_say(road, params, car, v, other, seconds):
    """An oncoming car and a slower one ahead, and what stands."""
    assume(v - other > 8.0)
    scene = road(PredictedObstacle(1, (v - other) * seconds, 0.0, 1.0, other, 0.0), v=v)
    (hazard,) = ways.road_ahead(scene, start(v), (), car, params).hazards
    touch = (1.0 + R_VEH) / (v - other)
    assert hazard.enter == pytest.approx(seconds - touch, abs=1.01 * STEP_S)
    leave = min(seconds + touch, 50 * STEP_S)  # within the horizon
    assert hazard.leave == pytest.approx(leave, abs=1.01 * STEP_S)


@pytest.mark.parametrize('Y', [-6.0, 5.0, 40.0])
def test_an_obstacle_beside_the_way_is_no_danger_but_on_a_plan_it_is(road, params, car, Y):
    scene, plan = road(standing(1, 30.0, Y)), straight_line(50.0, Y=Y - 1.0)
    assert ways.road_ahead(scene, start(), (), car, params) is None
    around = ways.road_ahead(scene, start(), (plan,), car, params)
    assert [h.id for h in around.hazards] == [1]


@quick
@given(gap=st.floats(0.0, 4.0))
def test_between_two_obstacles_there_is_a_way_where_the_circle_fits(road, params, car, gap):
    assume(abs(gap - 2 * R_VEH) > 1e-6)
    scene = road(standing(1, 30.0, 1 + gap / 2), standing(2, 30.0, -1 - gap / 2))
    sides = [way[0] for way in all_guesses(scene, start(), car, params)]
    assert ({1: RIGHT, 2: LEFT} in sides) == (gap > 2 * R_VEH)
    assert {1: LEFT, 2: RIGHT} not in sides  # on both sides at once


def test_obstacles_in_turn_have_every_combination_the_easiest_first(road, params, car):
    scene = road(standing(1, 25.0, 2.0), standing(2, 48.0, -2.0))
    combinations = all_guesses(scene, start(), car, params)
    sides = [tuple(way[0].values()) for way in combinations]
    assert sorted(sides) == [(-1, -1), (-1, 1), (1, -1), (1, 1)]
    assert sides[0] == (RIGHT, LEFT)
    peaks = [way[1].acceleration for way in combinations]
    assert peaks == sorted(peaks)
    narrow = road(standing(1, 30.0, 0.0), half_width=3.0)
    assert all_guesses(narrow, start(), car, params) == []


# braking


@quick
@given(
    v=st.floats(9.0, 35.0),
    Fx=st.floats(-15e3, 3e3),
    kappa=st.floats(0.001, 0.02),
    floor=st.sampled_from([None, 0.0]),
)
def test_the_braking_guess_keeps_to_its_line_and_uses_the_friction_that_the_bend_leaves(
    params, car, v, Fx, kappa, floor
):
    """It builds up its force at the rate limit, and stands where its speed is 0."""
    limits = params.limits
    available = limits.friction_use * min(car.mu_f, car.mu_r) * GRAVITY
    assume(v**2 * kappa < 0.75 * available)
    line = straight_line(v * 2.5, v)
    s = line[:, 6]
    line[:, 0], line[:, 1] = np.sin(kappa * s) / kappa, (1 - np.cos(kappa * s)) / kappa
    line[:, 2], line[:, 5] = kappa * s, v * kappa
    guess = guesses.braking(line, start(v)._replace(Fx=Fx), car, params, floor)
    x = State(*guess.X.T)
    rates = np.diff(guess.X[:, -2:], axis=0)[1:] / STEP_S
    most = limits.steer_rate_radps, limits.force_rate_nps
    assert guess.U[1:, :2] == pytest.approx(np.clip(rates, np.negative(most), most))
    # chords of a quarter of a metre to 1.5 m beside the arc
    assert np.max(np.abs(np.hypot(x.X, x.Y - 1 / kappa) - 1 / kappa)) < 0.01
    least = limits.least_speed_mps if floor is None else 0.0
    assert x.vx.min() >= least - 1e-9
    hardest = math.sqrt(available**2 - (v**2 * kappa) ** 2)
    deceleration = -np.diff(x.vx)[x.vx[1:] > least] / STEP_S
    assert np.max(deceleration, initial=0.0) <= max(hardest, -Fx / car.m) + 1e-9
    t = STEP_S * (np.arange(len(deceleration)) + 0.5)
    assert np.all(deceleration <= (max(-Fx, 0.0) + limits.force_rate_nps * t) / car.m + 1e-9)
    late = t > STEP_S + (abs(Fx) + car.m * hardest) / limits.force_rate_nps
    assert deceleration[late] == pytest.approx(hardest)
    moved = np.hypot(np.diff(x.X), np.diff(x.Y)) / STEP_S
    assert moved[1:] == pytest.approx((x.vx[2:] + x.vx[1:-1]) / 2, abs=0.02 * v)
    stands = x.vx < 1e-9
    assert np.all(np.abs(np.array([x.vy, x.r])[:, stands]) < 0.02)


def test_a_car_stops_where_the_braking_guess_promises(world):
    """On the plant, by the law that brakes without a plan, from no force on a dry road."""
    v, (params, _) = 25.0, world.load('mpcc_road')
    plant = Simulator(plant_parameters.load(), 1.0, Start(0.0, 0.0, 0.0, v, 0.0, 0.0))
    car = stage_parameters.car(params, car_file.load(params))
    line = straight_line(6.0 * v, stages=121)
    promised = guesses.braking(line, start(v), car, params, floor=0.0).X[-1, 0]
    now = Setpoints(0.0, 0.0)
    while plant.state.vx > 0.1:
        x = plant.state
        target = braking.braking_target(x, now, braking.Point(x.X + 20.0, 0.0), car, params)
        command = command_to(target, now, car, STEP_S, x.stamp_ns)
        now = setpoints_of(command, car)[0]
        plant.advance(command, 50)
    assert 0.95 * promised < plant.state.X < promised + 1.0


# the last plan and the path as guesses


def test_theta_of_a_shifted_plan_starts_at_the_new_foot(car):
    foot = State(1.1, 0.2, 0.0, 19.9, 0.0, 0.0, 1.4, 0.01, -10.0)
    plan = Plan(straight_line(4.0, 20.0, stages=5), np.zeros((4, 4)))
    moved = guesses.start_at(shift(plan, single_track.step(STEP_S), np.array(car)), foot)
    states = State(*moved.X.T)
    assert tuple(moved.X[0]) == foot
    assert states.theta == pytest.approx([1.4, 2.4, 3.4, 4.4, 5.4], abs=1e-2)
    assert states.X[1:4] == pytest.approx([2, 3, 4])


def test_without_a_plan_the_guess_blends_from_the_car_to_the_path(world, car):
    path = reference_path.build(world.lane_change().reference)
    x0 = State(20.0, 1.0, 0.1, 20.0, 0.5, 0.1, 20.0, 0.0, 0.0)
    guess = guesses.from_path(path, x0, car, 50, STEP_S)
    states = State(*guess.X.T)
    assert tuple(guess.X[0]) == x0
    assert states.Y[1] == pytest.approx(1.0 * 49 / 50, abs=1e-6)
    end, _ = reference_path.arcs_at(path, states.theta[-1:])
    assert states.Y[-1] == pytest.approx(float(end.Y[0]))
    assert np.all(np.diff(states.theta) == pytest.approx(1.0))


# how a plan passes obstacles


@pytest.mark.parametrize(
    ('obstacle', 'end', 'side'),
    [
        (standing(1, 40.0, 0.5), 30.0, BEHIND),
        # beside it only at its end, it has not passed it
        (standing(1, 50.0, -2.5), 48.5, BEHIND),
        (standing(1, 50.0, -2.5), 50.0, LEFT),
        (standing(1, 50.0, -2.5), 51.5, LEFT),
        (standing(1, 50.0, 2.5), 51.5, RIGHT),
    ],
)
def test_on_which_side_a_plan_passes(road, params, obstacle, end, side):
    plan = straight_line(end)
    assert ways.passed_sides(plan, road(obstacle), [0], params) == {1: side}


def test_sides_are_named_and_opposed_where_one_obstacle_is_passed_on_both():
    assert ways.name_of({1: LEFT, 4: RIGHT, 5: BEHIND}) == 'left of 1, right of 4, behind of 5'
    assert ways.are_opposed({1: LEFT, 2: LEFT}, {2: RIGHT})
    assert not ways.are_opposed({1: LEFT, 2: BEHIND}, {1: LEFT, 2: RIGHT})
    assert not ways.are_opposed({1: LEFT}, {2: RIGHT})


@pytest.mark.parametrize(
    ('obstacle', 'speed'),
    [
        (standing(1, 30.0, 0.0), 20.0),
        (PredictedObstacle(1, 60.0, 0.0, 1.0, -15.0, 0.0), 35.0),
        (PredictedObstacle(1, 20.0, 0.0, 1.0, 8.0, 0.0), 12.0),
        (standing(1, 30.0, 3.0), 0.0),
        (standing(1, 70.0, 0.0), 0.0),  # beyond the horizon
    ],
)
def test_the_contact_speed_is_that_of_both_cars(road, params, obstacle, speed):
    plan = straight_line(50.0, 20.0)
    plan[:, 6] = 0.0
    assert ways.contact_speed(plan, road(obstacle), params) == pytest.approx(speed)


@pytest.mark.parametrize(('v', 'desired'), [(2.0, 14.0), (0.0, 25.0), (13.0, 14.0), (20.0, 14.0)])
def test_regaining_the_speed_costs_what_its_errors_sum_up_to(road, params, car, v, desired):
    """The reference sums the cost of the velocity tick by tick at the largest driving force."""
    plan, scene = straight_line(0.0, v), road(v=desired)
    acceleration, expected = params.limits.drive_n / car.m, 0.0
    for t in np.arange(0.5 * STEP_S, 20.0, STEP_S):
        lacking = max(desired - v - acceleration * t, 0.0)
        expected += (lacking / params.tolerances.velocity_mps) ** 2
    cost = choose.regaining_cost(plan, scene, car, params)
    assert cost == pytest.approx(expected, rel=0.01, abs=0.01)
    coasting = dataclasses.replace(params, limits=dataclasses.replace(params.limits, drive_n=0.0))
    assert choose.regaining_cost(plan, scene, car, coasting) == 0.0
