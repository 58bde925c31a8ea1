"""Recovery of a sliding car: limits for every state, and cars that are saved on the plant."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.driving import braking, path_progress, planner, recovery
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


@settings(max_examples=200)
@given(SPEEDS, SPEEDS, st.floats(-10, 10), st.floats(-3.1, 3.1), SHARES, SHARES, st.booleans())
def test_every_command_of_any_finite_state_passes_the_gate(
    car, params, world, vx, vy, r, psi, steer, force, has_line
):
    limits, step_s = params.limits, params.model.step_s
    x = world.rolling(v=vx, vy=vy, r=r)._replace(psi=psi)
    hardest = braking.max_braking_force(0.0, car, limits)
    Fx = force * (limits.drive_n if force > 0 else hardest)
    front = 0.0 if Fx > 0 else float(single_track.ideal_split(Fx, car)) * Fx
    last = Command(1, steer * limits.steer_rad, 0.0, front, Fx - front)
    now = setpoints_of(last, car)[0]
    line = Point(10.0, 2.0) if has_line else None
    target = recovery.recovery_target(x, now, line, car, params)
    command = command_to(target, now, car, step_s, 2)
    assert Gate(limits, car, step_s, 1.0).check(command, last, 0.0, car).reason == ''


@pytest.mark.parametrize('sign', [1, -1])
def test_it_counter_steers_a_tail_that_swings_out_and_does_not_brake_first(
    car, params, world, sign
):
    """It drifts to the left of its heading and yaws to the right: it steers to the left."""
    x = world.rolling(v=20.0, vy=sign * 7.0, r=-sign * 0.6)
    rest = Setpoints(0.0, 0.0)
    target = recovery.recovery_target(x, rest, None, car, params)
    step_s, limits = params.model.step_s, params.limits
    assert sign * target.delta == pytest.approx(limits.steer_rate_radps * step_s)
    assert target.Fx == pytest.approx(0.0, abs=100.0)
    along = braking.braking_target(x, rest, Point(20.0, 0.0), car, params)
    assert along.Fx < -1000.0


def test_a_car_whose_brakes_leave_no_side_force_releases_them(car, params, world):
    ice = car._replace(mu_f=0.2, mu_r=0.2)
    x = world.rolling(v=20.0, vy=6.0)
    target = recovery.recovery_target(x, Setpoints(0.0, -12000.0), None, ice, params)
    step_n = params.limits.force_rate_nps * params.model.step_s
    assert target.Fx == pytest.approx(-12000.0 + step_n)


@pytest.mark.parametrize('share', [0.0, 1.0])
def test_a_car_that_brakes_with_one_axle_only_is_recovered_with_that_axle(
    car, params, world, share
):
    only = {'brake_front_share_min': share, 'brake_front_share_max': share}
    params = dataclasses.replace(params, limits=dataclasses.replace(params.limits, **only))
    x = world.rolling(stamp_ns=0)._replace(vx=20.0, vy=-4.0, r=0.5)
    target = recovery.recovery_target(x, Setpoints(0.0, 0.0), None, car, params)
    assert np.all(np.isfinite(target))
    assert target.lambda_b == pytest.approx(share)


def test_it_mirrors(car, params, world):
    rest = Setpoints(0.0, 0.0)
    left = recovery.recovery_target(
        world.rolling(v=18.0, vy=4.0, r=0.5), rest, Point(9.0, 1.0), car, params
    )
    right = recovery.recovery_target(
        world.rolling(v=18.0, vy=-4.0, r=-0.5), rest, Point(9.0, -1.0), car, params
    )
    assert left == pytest.approx((-right.delta, right.Fx, right.lambda_b))


def test_slow_cars_unknown_states_and_cornering_at_the_limit_do_not_slide(car, world):
    assert not recovery.is_sliding(world.rolling(v=1.0, vy=2.0, r=0.0), car)
    assert not recovery.is_sliding(world.rolling(v=20.0, vy=np.nan, r=0.0), car)
    assert not recovery.is_sliding(world.rolling(v=20.0, vy=0.0, r=0.45), car)
    assert recovery.is_sliding(world.rolling(v=20.0, vy=4.0, r=0.0), car)
    assert recovery.is_sliding(world.rolling(v=-5.0, vy=0.1, r=0.0), car)


def test_on_a_slippery_road_a_car_slides_at_a_smaller_slip_and_goes_on_sliding(car, world):
    """Full sliding begins at a slip that is proportional to the friction."""
    ice = car._replace(mu_f=0.3 * car.mu_f, mu_r=0.3 * car.mu_r)
    x = world.rolling(v=20.0, vy=-1.0, r=0.0)  # 2.9 deg
    assert recovery.is_sliding(x, ice)
    assert not recovery.is_sliding(x, car)
    smaller = world.rolling(v=20.0, vy=-0.6, r=0.0)
    assert not recovery.is_sliding(smaller, ice)
    assert recovery.is_sliding(smaller, ice, slid=True)
    assert not recovery.is_sliding(world.rolling(v=20.0, vy=-0.1, r=0.0), ice, slid=True)


@pytest.fixture(scope='module')
def spin(world):
    """Return a function that drives a sliding car whose solver always fails, on the plant."""
    params, vehicle = world.load(solver__max_iterations=1)
    ways = {}
    for recovers in (True, False):
        fallback = dataclasses.replace(params.fallback, recovery=recovers)
        ways[recovers] = Controller(dataclasses.replace(params, fallback=fallback), vehicle)

    def driven(recovers, speed, vy, r, seconds=4.0):
        controller = world.set_inputs(ways[recovers], world.straight())
        start = Start(0.0, 0.0, -math.atan2(vy, speed), speed, vy, r)  # it moves along the road
        plant = Simulator(plant_parameters.load(), 1.0, start)
        records = []
        for _ in range(round(seconds / 0.05)):
            records.append(controller.step(TickInputs(plant.state)))
            plant.advance(records[-1].command, 50)
        assert plant.gate.rejected == 0
        return records

    return driven


def sideslips(records):
    """Return the sideslip angles [rad] while the car moves."""
    states = [record.state for record in records]
    return np.array([np.arctan2(x.vy, x.vx) for x in states if np.hypot(x.vx, x.vy) > 1.0])


@pytest.mark.parametrize(('speed', 'vy', 'r'), [(23.0, 8.0, 0.0), (18.0, 6.5, 0.5)])
def test_a_slide_that_spins_the_braked_car_is_recovered(spin, speed, vy, r):
    braked, recovered = (spin(recovers, speed, vy, r) for recovers in (False, True))
    assert abs(sideslips(braked)).max() > math.radians(90)
    assert {record.decision.level for record in braked} == {BRAKING}
    assert abs(sideslips(recovered)).max() < math.radians(30)
    last = recovered[-1]
    assert abs(last.state.r) < 0.1
    assert abs(sideslips(recovered)[-1]) < math.radians(5)
    assert recovered[0].decision.level == RECOVERY
    assert last.decision.level == BRAKING
    assert not any(record.gate_reason for record in recovered)


def initial_state(x, now, scene, params):
    """Return stage 0 at a start."""
    return path_progress.initial_state(Progress(), x, now, scene, None, params)[1]


@pytest.fixture(scope='module')
def controller_on_road(world):
    return world.set_inputs(Controller(*world.load()), world.straight())


@settings(max_examples=25)
@given(st.floats(7, 40), st.floats(-1, 1), st.floats(-2, 2), st.floats(-0.3, 0.3))
def test_the_guess_of_a_sliding_car_obeys_model_and_limits_from_any_state(
    controller_on_road, v, beta, r, delta
):
    parts, scene = controller_on_road.parts, controller_on_road.scene
    limits, step_s = parts.params.limits, parts.params.model.step_s
    x0 = State(9.0, 1.0, -beta, v * math.cos(beta), v * math.sin(beta), r, 9.0, delta, 0.0)
    plan = planner.guess_from_law(x0, scene, parts.model.car, parts)
    assert np.isfinite(plan.X).all()
    assert plan.X[0] == pytest.approx(np.array(x0))
    step = single_track.step(step_s)
    for x, u, after in zip(plan.X, plan.U, plan.X[1:]):
        assert after == pytest.approx(step(x, u, parts.model.car).full().ravel(), abs=1e-9)
    states, inputs = State(*plan.X.T), Input(*plan.U.T)
    rounding = 1 + 1e-9
    assert abs(states.delta).max() <= limits.steer_rad * rounding
    assert abs(inputs.d_delta).max() <= limits.steer_rate_radps * rounding
    assert abs(inputs.d_Fx).max() <= limits.force_rate_nps * rounding


def test_from_the_guess_of_the_law_most_sliding_cars_get_a_plan(world):
    """Sideslip to 60 deg, yaw rate to 2 rad/s, 7 to 40 m/s."""
    params, vehicle = world.load(solver__max_iterations=300)
    controller = world.set_inputs(Controller(params, vehicle), world.straight())
    parts, scene = controller.parts, controller.scene
    rng = np.random.default_rng(7)
    usable, count = 0, 40
    for _ in range(count):
        v, beta, r = rng.uniform((7, -1.05, -2), (40, 1.05, 2))
        x = world.rolling(v=v * math.cos(beta), vy=v * math.sin(beta), r=r, X=10.0, psi=-beta)
        x0 = initial_state(x, Setpoints(0.0, 0.0), scene, parts.params)
        guess = planner.guess_from_law(x0, scene, parts.model.car, parts)
        problem = parts.model.build_problem(x0, scene, guess, parts.model.car)
        solution = parts.solvers.solve(problem)
        usable += not rejection_reason(solution, params.fallback)
    assert usable > 0.75 * count


def test_every_sliding_car_gets_a_plan_of_the_road_controller(world):
    """Sideslip to 60 deg, yaw rate to 2 rad/s, 7 to 40 m/s, on a road of 8 m."""
    params, vehicle = world.load('mpcc_road', candidates__most=1)
    off = dataclasses.replace(params.friction_estimate, on=False)
    controller = Controller(dataclasses.replace(params, friction_estimate=off), vehicle)
    world.set_inputs(controller, world.straight(left=4.0, right=-4.0))
    parts, scene = controller.parts, controller.scene
    rng = np.random.default_rng(7)
    plans = []
    for _ in range(40):
        v, beta, r = rng.uniform((7, -1.05, -2), (40, 1.05, 2))
        x = world.rolling(v=v * math.cos(beta), vy=v * math.sin(beta), r=r, X=10.0, psi=-beta)
        x0 = initial_state(x, Setpoints(0.0, 0.0), scene, parts.params)
        _, decision, _ = planner.plan(controller.memory, x0, scene, controller.car, True, parts)
        plans.append(decision.plan)
    assert all(plan is not None for plan in plans)
    for plan in plans:  # each is a motion of the model
        for x, u, after in zip(plan.X[:-1:10], plan.U[::10], plan.X[1::10]):
            assert after == pytest.approx(
                parts.model.step(x, u, controller.car), abs=0.02, rel=1e-3
            )


class OnlyRelaxed:
    """A solver that fails at one set of stage parameters."""

    def __init__(self, solver, P):
        self.solver, self.P, self.relaxed = solver, P, []
        self.set_time_limit = solver.set_time_limit

    def solve(self, x0, P, bounds, guess):
        solution = self.solver.solve(x0, P, bounds, guess)
        if np.array_equal(P, self.P):
            return solution._replace(status=FAILED)
        self.relaxed.append(solution)
        return solution


def test_a_plan_of_relaxed_soft_limits_has_its_cost_in_the_true_problem(world):
    params, vehicle = world.load('mpcc_road', candidates__most=1)
    controller = Controller(params, vehicle)
    world.set_inputs(controller, world.straight(left=1.0, right=-1.0))
    parts, scene = controller.parts, controller.scene
    x0 = initial_state(world.rolling(v=20.0, vy=3.0, X=10.0), Setpoints(0, 0), scene, parts.params)
    problem = planner.plan(controller.memory, x0, scene, controller.car, True, parts)[2].problem
    true = parts.solvers.solve(problem)
    P = problem.parameters.P
    local = parts.model.formulation.to_local(true.plan, scene.path)
    assert parts.model.evaluator.cost(local, P) == pytest.approx(true.cost, rel=1e-6)

    parts.solvers.sliding = stuck = OnlyRelaxed(parts.solvers.sliding, P)
    driven = parts.solvers.solve(problem)
    (relaxed,) = stuck.relaxed
    assert relaxed.status == SOLVED
    assert driven.status == STOPPED_EARLY
    assert not rejection_reason(driven, params.fallback)
    assert driven.plan.X[:, 0] == pytest.approx(relaxed.plan.X[:, 0], abs=1e-6)
    assert driven.cost == pytest.approx(parts.model.evaluator.cost(relaxed.plan, P))
    assert driven.cost > max(true.cost, 2.0 * relaxed.cost)
