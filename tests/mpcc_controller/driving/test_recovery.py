"""Recovery of a sliding car: limits for every state, and cars that are saved on the plant."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.driving import (
    braking,
    guesses,
    last_resort,
    path_progress,
    planner,
    recovery,
)
from mpcc_controller.driving.braking import Point
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.fallback import BRAKING, RECOVERY, rejection_reason
from mpcc_controller.driving.gate import Gate
from mpcc_controller.driving.path_progress import Progress
from mpcc_controller.driving.records import TickInputs
from mpcc_controller.driving.setpoints import Setpoints, command_to, setpoints_of
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Input, State
from msgs_yaml.types import Command
from stage_solver.solution import FAILED, SOLVED, STOPPED_EARLY
from vehicle_plant import parameters as plant_parameters
from vehicle_plant.initial_state import Start
from vehicle_plant.simulator import Simulator

SPEEDS, SHARES = st.floats(-60, 60), st.floats(-1, 1)
REST = Setpoints(0.0, 0.0)


@pytest.mark.parametrize('law', [braking.braking_target, recovery.recovery_target])
@settings(max_examples=150)
@given(SPEEDS, SPEEDS, st.floats(-10, 10), st.floats(-3.1, 3.1), SHARES, SHARES, st.booleans())
def test_every_command_of_any_finite_state_passes_the_gate(
    car, params, world, law, vx, vy, r, psi, steer, force, has_line
):
    limits, step_s = params.limits, params.model.step_s
    x = world.rolling(v=vx, vy=vy, r=r, psi=psi)
    hardest = braking.max_braking_force(0.0, car, limits)
    Fx = force * (limits.drive_n if force > 0 else hardest)
    front = 0.0 if Fx > 0 else float(single_track.ideal_split(Fx, car)) * Fx
    last = Command(1, steer * limits.steer_rad, 0.0, front, Fx - front)
    now = setpoints_of(last, car)[0]
    line = Point(10.0, 2.0) if has_line else None
    target = law(x, now, line, car, params)
    command = command_to(target, now, car, step_s, 2)
    assert Gate(limits, car, step_s, 1.0).check(command, last, 0.0, car).reason == ''


def test_it_counter_steers_a_tail_that_swings_out_does_not_brake_first_and_mirrors(
    car, params, world
):
    """It drifts to the left of its heading and yaws to the right: it steers to the left."""
    x = world.rolling(vy=7.0, r=-0.6)
    target = recovery.recovery_target(x, REST, None, car, params)
    assert target.delta == pytest.approx(params.limits.steer_rate_radps * params.model.step_s)
    assert target.Fx == pytest.approx(0.0, abs=100.0)
    assert braking.braking_target(x, REST, Point(20.0, 0.0), car, params).Fx < -1000.0
    left, right = (
        recovery.recovery_target(
            world.rolling(v=18.0, vy=4.0 * side, r=0.5 * side), REST, Point(9.0, side), car, params
        )
        for side in (1.0, -1.0)
    )
    assert left == pytest.approx((-right.delta, right.Fx, right.lambda_b))


def test_a_soft_steering_is_a_spring_before_that_of_the_tyre(car, params, world):
    """Braking, recovery and last resort steer a car of small slips as one of a softer tyre."""
    soft = car._replace(C_f=1 / (1 / car.C_f - 5e-6), compliance=5e-6)
    x, line = world.rolling(v=20.0, vy=0.02, r=0.01), Point(40.0, 0.3)
    rules = params.limits, params.braking, params.model.step_s
    straight = np.array([[0.0, 0.0], [100.0, 0.75]])
    brake = Command(0, 0.0, 0.0, -8000.0, -6000.0)
    for steer in (
        lambda car: recovery.recovery_target(x, REST, line, car, params).delta,
        lambda car: braking.braking_target(x, REST, line, car, params).delta,
        lambda car: last_resort.braking_command(x, brake, straight, car, *rules).delta,
    ):
        delta, stiff = steer(soft), steer(car._replace(C_f=soft.C_f))
        assert delta == pytest.approx(steer(car), rel=0.05)
        assert abs(delta) < 0.9 * params.limits.steer_rate_radps * params.model.step_s
        assert stiff != pytest.approx(delta, rel=0.16)


def test_a_car_whose_brakes_leave_no_side_force_releases_them(car, params, world):
    ice = car._replace(mu_f=0.2, mu_r=0.2)
    braked = Setpoints(0.0, -12000.0)
    target = recovery.recovery_target(world.rolling(vy=6.0), braked, None, ice, params)
    step_n = params.limits.force_rate_nps * params.model.step_s
    assert target.Fx == pytest.approx(-12000.0 + step_n)


@pytest.mark.parametrize('share', [0.0, 1.0])
def test_a_car_that_brakes_with_one_axle_only_is_recovered_with_that_axle(car, world, share):
    ends = {f'limits__brake_front_share_{end}': share for end in ('min', 'max')}
    params, _ = world.load(**ends)
    target = recovery.recovery_target(world.rolling(vy=-4.0, r=0.5), REST, None, car, params)
    assert np.all(np.isfinite(target))
    assert target.lambda_b == pytest.approx(share)


@pytest.mark.parametrize(
    ('motion', 'friction', 'slid', 'expected'),
    [
        ({'v': 1.0, 'vy': 2.0}, 1.0, False, False),  # slow
        ({'vy': np.nan}, 1.0, False, False),
        ({'r': 0.45}, 1.0, False, False),  # cornering at the limit
        ({'vy': 4.0}, 1.0, False, True),
        ({'v': -5.0, 'vy': 0.1}, 1.0, False, True),
        # full sliding begins at a slip that is proportional to the friction
        ({'vy': -1.0}, 1.0, False, False),
        ({'vy': -1.0}, 0.3, False, True),
        ({'vy': -0.6}, 0.3, False, False),
        ({'vy': -0.6}, 0.3, True, True),
        ({'vy': -0.1}, 0.3, True, False),
    ],
)
def test_which_car_slides(car, world, motion, friction, slid, expected):
    road = car._replace(mu_f=friction * car.mu_f, mu_r=friction * car.mu_r)
    assert recovery.is_sliding(world.rolling(**motion), road, slid) == expected


@pytest.fixture(scope='module')
def spin(world):
    """Return a function that drives a sliding car whose solver always fails, on the plant."""
    ways = {
        recovers: Controller(*world.load(solver__max_iterations=1, fallback__recovery=recovers))
        for recovers in (True, False)
    }

    def driven(recovers, speed, vy, r):
        controller = world.set_inputs(ways[recovers], world.straight())
        start = Start(0.0, 0.0, -math.atan2(vy, speed), speed, vy, r)  # it moves along the road
        plant = Simulator(plant_parameters.load(), 1.0, start)
        records = []
        for _ in range(80):
            records.append(controller.step(TickInputs(plant.state)))
            plant.advance(records[-1].command, 50)
        assert plant.gate.rejected == 0
        states = [record.state for record in records]
        moving = [x for x in states if np.hypot(x.vx, x.vy) > 1.0]
        return records, np.array([math.atan2(x.vy, x.vx) for x in moving])

    return driven


def test_a_slide_that_spins_the_braked_car_is_recovered(spin):
    speed, vy, r = 18.0, 6.5, 0.5
    records, sideslip = spin(False, speed, vy, r)
    assert abs(sideslip).max() > math.radians(90)
    assert {record.decision.level for record in records} == {BRAKING}
    records, sideslip = spin(True, speed, vy, r)
    assert abs(sideslip).max() < math.radians(30)
    assert abs(sideslip[-1]) < math.radians(5)
    assert abs(records[-1].state.r) < 0.1
    levels = [record.decision.level for record in records]
    assert (levels[0], levels[-1]) == (RECOVERY, BRAKING)
    assert not any(record.gate_reason for record in records)


@pytest.fixture(scope='module')
def road_controller(world):
    """Return the road's controller without other candidates, on a road of 8 m."""
    params, vehicle = world.load('mpcc_road', candidates__most=1, friction_estimate__on=False)
    return world.set_inputs(Controller(params, vehicle), world.straight(left=4.0, right=-4.0))


@settings(max_examples=25)
@given(st.floats(7, 40), st.floats(-1, 1), st.floats(-2, 2), st.floats(-0.3, 0.3))
def test_the_guess_of_a_sliding_car_obeys_model_and_limits_from_any_state(
    road_controller, v, beta, r, delta
):
    parts, scene = road_controller.parts, road_controller.scene
    limits = parts.params.limits
    x0 = State(9.0, 1.0, -beta, v * math.cos(beta), v * math.sin(beta), r, 9.0, delta, 0.0)
    plan = guesses.from_recovery(x0, scene.path, parts.model.car, parts.model.step, parts.params)
    assert np.isfinite(plan.X).all()
    assert plan.X[0] == pytest.approx(np.array(x0))
    for x, u, after in zip(plan.X, plan.U, plan.X[1:]):
        assert after == pytest.approx(parts.model.step(x, u, parts.model.car), abs=1e-9)
    states, inputs = State(*plan.X.T), Input(*plan.U.T)
    rounding = 1 + 1e-9
    assert abs(states.delta).max() <= limits.steer_rad * rounding
    assert abs(inputs.d_delta).max() <= limits.steer_rate_radps * rounding
    assert abs(inputs.d_Fx).max() <= limits.force_rate_nps * rounding


def plan_of(controller, x):
    """Return the decision and the attempt of a first tick of a sliding car."""
    scene, params = controller.scene, controller.parts.params
    _, x0 = path_progress.initial_state(Progress(), x, REST, scene, None, params)
    return planner.plan(controller.memory, x0, scene, controller.car, True, controller.parts)[1:]


def test_every_sliding_car_gets_a_plan_of_the_road_controller(road_controller, world):
    """Sideslip to 60 deg, yaw rate to 2 rad/s, 7 to 40 m/s."""
    rng, step, car = np.random.default_rng(7), road_controller.parts.model.step, road_controller.car
    for _ in range(12):
        v, beta, r = rng.uniform((7, -1.05, -2), (40, 1.05, 2))
        x = world.rolling(v=v * math.cos(beta), vy=v * math.sin(beta), r=r, X=10.0, psi=-beta)
        plan = plan_of(road_controller, x)[0].plan
        assert plan is not None
        for x, u, after in zip(plan.X[:-1:10], plan.U[::10], plan.X[1::10]):
            assert after == pytest.approx(step(x, u, car), abs=0.02, rel=1e-3)


def test_a_plan_of_relaxed_soft_limits_has_its_cost_in_the_true_problem(
    road_controller, world, monkeypatch
):
    world.set_inputs(road_controller, world.straight(left=1.0, right=-1.0))
    parts = road_controller.parts
    problem = plan_of(road_controller, world.rolling(vy=3.0, X=10.0))[1].problem
    true, P = parts.solvers.solve(problem), problem.parameters.P
    cost = parts.model.evaluator.cost
    local = parts.model.formulation.to_local(true.plan, road_controller.scene.path)
    assert cost(local, P) == pytest.approx(true.cost, rel=1e-6)

    stuck = world.ModifiedSolver(parts.solvers.sliding)  # in the true problem
    stuck.modify = lambda s: s._replace(status=FAILED) if np.array_equal(stuck.P, P) else s
    monkeypatch.setattr(parts.solvers, 'sliding', stuck)
    driven = parts.solvers.solve(problem)
    (relaxed,) = (solution for solution in stuck.solutions if solution.status != FAILED)
    assert (relaxed.status, driven.status) == (SOLVED, STOPPED_EARLY)
    assert not rejection_reason(driven, parts.params.fallback)
    assert driven.plan.X[:, 0] == pytest.approx(relaxed.plan.X[:, 0], abs=1e-6)
    assert driven.cost == pytest.approx(cost(relaxed.plan, P))
    assert driven.cost > max(true.cost, 2.0 * relaxed.cost)
