"""The problem itself: cost, weights, constraints, against hand-made numbers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller import run_time_parameters
from mpcc_controller.driving import guesses, ways
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Input, State
from mpcc_controller.path import road_edges
from mpcc_controller.problem import (
    bounds,
    cost_terms,
    formulation,
    mpcc_formulation,
    ocp,
    stage_parameters,
)
from mpcc_controller.problem.plan_evaluator import PlanEvaluator
from msgs_yaml.types import Obstacle, Obstacles, RoadEdges
from node_runtime import named_vector
from stage_solver.stage_problem import Plan

quick = settings(max_examples=30)
N, DT = 50, 0.05


@pytest.fixture(scope='module')
def problem(mpcc):
    return ocp.build(mpcc.ocp, N, DT)


@pytest.fixture(scope='module')
def numbers(car, scene, mpcc):
    x0 = State(20.0, 0.2, 0.05, 20.0, 0.3, 0.1, 20.0, 0.01, -500.0)
    plan = guesses.from_path(scene.path, x0, car, N, DT)
    return plan, mpcc.stage_parameters(scene, plan.X)


def wild(plan, seed):
    """Return a plan that visits obstacles, edges and both signs of everything."""
    random = np.random.default_rng(seed)
    spread = State(2, 3, 0.2, 4, 1, 0.5, 2, 0.2, 5000)
    push = Input(0.4, 2e4, 0.2, 0.5)
    X = plan.X + random.uniform(-1, 1, plan.X.shape) * spread
    return Plan(X, plan.U + random.uniform(-1, 1, plan.U.shape) * push)


@quick
@given(st.integers(0, 1000))
def test_the_objective_is_the_sum_of_the_logged_terms(problem, numbers, mpcc, seed):
    plan, given_numbers = numbers
    plan, P = wild(plan, seed), given_numbers.P
    cost = float(problem.terminal_cost(plan.X[-1], P[-1]))
    cost += problem.stage_cost.map(N)(plan.X[:-1].T, plan.U.T, P[:-1].T).full().sum()
    view = PlanEvaluator(mpcc.ocp).evaluate(plan, P)
    assert sum(np.sum(term) for term in view.costs) == pytest.approx(cost, rel=1e-12)


def test_weights_and_errors_have_the_same_names():
    formula = mpcc_formulation.symbolic_ocp(1, 2)
    numeric = named_vector.build(
        formula.template, [1.0] * len(named_vector.leaves(formula.template))
    )
    errors = formula.errors(State(*[1.0] * 9), Input(*[0.5] * 4), numeric)
    assert set(errors) == set(numeric.weights._fields)


def test_weights_are_one_over_the_squared_tolerances(world):
    params, _ = world.load(
        tolerances__contouring_m=0.3,
        tolerances__lag_m=0.5,
        tolerances__steer_rate_radps=0.349,
        tolerances__force_rate_nps=2e4,
        priorities__obstacle=700.0,
        priorities__edge=30.0,
    )
    weights = cost_terms.weights(cost_terms.in_use(cost_terms.MPCC, params), params)
    assert weights.con == pytest.approx(1 / 0.09)
    assert weights.lag == pytest.approx(4)
    assert weights.d_delta == pytest.approx(8.2, rel=2e-3)
    assert weights.d_Fx * 1e6 == pytest.approx(1 / 400)
    assert (weights.v2o, weights.v2e) == (700, 30)


def test_only_the_priorities_differ_without_collision_avoidance(world):
    with_ca, _ = world.load('mpcc')
    without, _ = world.load(
        'mpcc_no_ca',
        priorities__obstacle=with_ca.priorities.obstacle,
        priorities__edge=with_ca.priorities.edge,
    )
    plain, _ = world.load('mpcc_no_ca')
    assert with_ca == without
    assert (plain.priorities.obstacle, plain.priorities.edge) == (0, 0)


def test_errors_are_those_of_the_paper(car, scene, mpcc):
    """Straight part of the path, heading 0: con is -dY, lag is -dX, everything by hand."""
    x = State(21.0, 0.4, 0.0, 18.0, 0.0, 0.0, 20.0, 0.0, 0.0)
    numbers = mpcc.stage_parameters(scene, np.tile(x, (N + 1, 1)))
    stage = named_vector.build(numbers.stages, numbers.P[0])
    errors = mpcc.ocp.errors(x, Input(0.1, 2000.0, 0.6, 0.2), stage)
    assert float(errors['con']) == pytest.approx(0.4**2)
    assert float(errors['lag']) == pytest.approx(1.0)
    assert float(errors['vel']) == pytest.approx((18 - 20) ** 2, rel=1e-3)
    assert float(errors['d_delta']) == pytest.approx(0.01)
    assert float(errors['d_Fx']) == pytest.approx(2000.0**2)
    assert float(errors['lambda_b']) == pytest.approx((0.6 - car.l_r / (car.l_f + car.l_r)) ** 2)
    assert float(errors['slack']) == pytest.approx(0.04)
    assert (float(errors['v2o']), float(errors['v2e'])) == (0, 0)


@pytest.mark.parametrize('offsets', [(0.0,), (-1.1, 1.1)])
def test_every_circle_counts_against_every_obstacle_and_edge(world, scene, offsets):
    params, vehicle = world.load(body__circle_offsets_m=offsets)
    mpcc = formulation.make(params, stage_parameters.car(params, vehicle))
    x = State(71.0, 4.9, 0.0, 20.0, 0.0, 0.0, 71.0, 0.0, 0.0)
    numbers = mpcc.stage_parameters(scene, np.tile(x, (N + 1, 1)))
    stage = named_vector.build(numbers.stages, numbers.P[0])
    errors = mpcc.ocp.errors(x, Input(0, 0, 0.5, 0), stage)
    D_o = [np.hypot(71.0 + o - 72.0, 4.9 - 1.5) - 2.1 for o in offsets]
    D_e = 6.0 - 4.9 - 1.1

    def cost(D, D_sft):
        q = 1 if D < 0 else np.exp(-2 * D**2 / D_sft**2) if D_sft >= D else 0
        return q * (D - D_sft) ** 2

    assert float(errors['v2o']) == pytest.approx(sum(cost(D, 0.5) for D in D_o), abs=1e-5)
    assert float(errors['v2e']) == pytest.approx(len(offsets) * cost(D_e, 0.5), abs=1e-6)


def test_obstacles_move_with_their_velocity(car, scene, mpcc):
    moving = scene.obstacles.items[0]._replace(vX=-2.0, vY=1.0)
    moved = scene._replace(obstacles=scene.obstacles._replace(items=(moving,)))
    plan = guesses.from_path(scene.path, State(0, 0, 0, 20.0, 0, 0, 0, 0, 0), car, N, DT)
    numbers = mpcc.stage_parameters(moved, plan.X)
    first = numbers.stages.obstacles[0]
    assert first.X[-1] == pytest.approx(moving.X - 2.0 * N * DT)
    assert first.Y[20] == pytest.approx(moving.Y + 1.0)


def test_of_many_obstacles_the_ones_nearest_to_the_plan_count(car, scene, mpcc):
    obstacle = scene.obstacles.items[0]
    row = [obstacle._replace(id=i, X=20.0 + 0.0 * i, Y=3.0 * i) for i in range(9, 0, -1)]
    crowd = scene._replace(obstacles=scene.obstacles._replace(items=tuple(row)))
    plan = guesses.from_path(scene.path, State(0, 0, 0, 20.0, 0, 0, 0, 0, 0), car, N, DT)
    numbers = mpcc.stage_parameters(crowd, plan.X)
    assert [o.id for o in numbers.obstacles] == [1, 2, 3, 4]


def test_an_empty_slot_costs_nothing_anywhere(problem, scene, numbers, mpcc):
    free = scene._replace(obstacles=scene.obstacles._replace(items=()))
    plan, _ = numbers
    P = mpcc.stage_parameters(free, plan.X).P
    view = PlanEvaluator(mpcc.ocp).evaluate(wild(plan, 1), P)
    assert np.all(view.costs.v2o == 0)


def test_constraints_are_the_paper_s_per_axle_and_for_the_road(car, scene, mpcc):
    x = State(20.0, 3.0, 0.0, 20.0, 0.0, 0.0, 20.0, 0.0, -8000.0)
    numbers = mpcc.stage_parameters(scene, np.tile(x, (N + 1, 1)))
    stage = named_vector.build(numbers.stages, numbers.P[0])
    values = mpcc_formulation.constraints(x, Input(0, 0, 0.7, 0.25), stage)
    Fz = single_track.loads(-8000.0, car)
    assert float(values.front) == pytest.approx(-5600 / (car.mu_f * Fz.f))
    assert float(values.rear) == pytest.approx(-2400 / (car.mu_r * Fz.r))
    # the road reaches from -2.5 to 6: its centre is 1.75, its half 4.25, the car's circle 1.1
    (beyond,) = values.track
    assert float(beyond) == pytest.approx(3.0 - 1.75 - (4.25 - 1.1) - 0.25, abs=1e-3)


@pytest.mark.parametrize('name', ['mpcc', 'frenet'])
def test_a_slow_car_may_not_leave_the_road_for_nothing(world, scene, name):
    """What it costs to be slow and off the road is the sum of what either costs."""
    params, vehicle = world.load(name)
    form = formulation.make(params, stage_parameters.car(params, vehicle))

    def least_cost(vx, beyond):
        Y = 1.75 + (4.25 - 1.1) + beyond  # from the middle of the road
        x = State(20.0, Y, 0.0, vx, 0.0, 0.0, 20.0, 0.0, 0.0)
        numbers = form.stage_parameters(scene, np.tile(x, (N + 1, 1)))
        stage = named_vector.build(numbers.stages, numbers.P[0])
        local = form.to_local(Plan(np.tile(x, (N + 1, 1)), np.zeros((N, 4))), scene.path)
        local = form.ocp.state(*local.X[0])
        needed = float(form.ocp.constraints(local, Input(0, 0, 0.5, 0.0), stage).track[0])
        errors = form.ocp.errors(local, Input(0, 0, 0.5, max(needed, 0.0)), stage)
        return sum(float(errors[term]) for term in ('slack', 'slow'))

    assert least_cost(6.0, -0.5) == pytest.approx(1.0)
    assert least_cost(8.0, 1.0) == pytest.approx(1.0, rel=0.01)
    assert least_cost(8.0, -0.5) == 0.0
    assert least_cost(6.0, 1.0) == pytest.approx(2.0, rel=0.01)


@pytest.mark.parametrize('name', ['mpcc', 'frenet'])
@pytest.mark.parametrize('ahead', [1, -1], ids=['nose', 'tail'])
def test_the_outline_stays_on_the_track(world, scene, name, ahead):
    """A car of three circles whose CoG is well on the road and an end of it is not."""
    params, vehicle = world.load(name, body__circles=3)
    params = run_time_parameters.in_force(params, vehicle)
    form = formulation.make(params, stage_parameters.car(params, vehicle))
    outline, yaw = vehicle.outline, 0.4 * ahead
    end = outline.front_m if ahead > 0 else outline.rear_m
    half_width = outline.width_m / 2

    def needed(beyond):
        """Return the slack of a car whose end, as wide as the car, is beyond the left edge."""
        Y = 6.0 + beyond - half_width - end * np.sin(abs(yaw))
        x = State(20.0, Y, yaw, 10.0, 0.0, 0.0, 20.0, 0.0, 0.0)
        plan = Plan(np.tile(x, (N + 1, 1)), np.zeros((N, 4)))
        numbers = form.stage_parameters(scene, plan.X)
        stage = named_vector.build(numbers.stages, numbers.P[0])
        local = form.ocp.state(*form.to_local(plan, scene.path).X[0])
        return max(form.ocp.constraints(local, Input(0, 0, 0.5, 0.0), stage).track)

    assert needed(0.3) == pytest.approx(0.3, abs=0.01)
    assert needed(-0.1) == pytest.approx(-0.1, abs=0.01)


def test_friction_bounds_are_the_safety_factor(params, car):
    solver_bounds = bounds.build(params.limits, car, -3000.0, N, DT)
    assert np.all(solver_bounds.g_high[:, :2] == params.limits.friction_use)
    assert np.all(solver_bounds.h_low == -params.limits.friction_use)


@quick
@given(
    Fx=st.floats(-17000.0, 6000.0),
    friction=st.floats(0.05, 1.5),
    lambda_d=st.floats(0.0, 1.0),
    split=st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)).map(sorted),
    drive_use=st.one_of(st.none(), st.floats(0.1, 1.0)),
)
def test_whatever_the_force_on_whatever_road_there_is_a_plan(
    world, Fx, friction, lambda_d, split, drive_use
):
    """The force falls as fast as it may, and some split within its bounds overloads no axle."""
    params, vehicle = world.load(
        model__friction=friction,
        model__drive_front_share=lambda_d,
        limits__brake_front_share_min=split[0],
        limits__brake_front_share_max=split[1],
        limits__drive_friction_use=drive_use,
    )
    limits, car = params.limits, stage_parameters.car(params, vehicle)
    given_bounds = bounds.build(limits, car, Fx, N, DT)
    fastest = np.maximum(abs(Fx) - limits.force_rate_nps * DT * np.arange(N + 1), 0)
    for k, force in enumerate(np.copysign(fastest, Fx)):
        Fz = single_track.loads(force, car)
        front, rear = car.mu_f * Fz.f, car.mu_r * Fz.r
        if k == N:
            assert given_bounds.h_low[0] <= force / (front + rear) <= given_bounds.h_high[0]
            break
        best = np.clip(front / (front + rear), *split)
        at_front = np.array([*np.linspace(*split, 101), best]) if Fx < 0 else np.array([lambda_d])
        uses = np.column_stack((at_front * force / front, (1 - at_front) * force / rear))
        low, high = given_bounds.g_low[k, :2], given_bounds.g_high[k, :2]
        assert np.any(np.all((low <= uses) & (uses <= high), axis=1))


def test_the_friction_bounds_are_back_where_the_force_may_be(world):
    params, vehicle = world.load(model__friction=0.3)
    Fx = -12000.0
    given_bounds = bounds.build(params.limits, stage_parameters.car(params, vehicle), Fx, N, DT)
    force_gone = int(np.ceil(-Fx / params.limits.force_rate_nps / DT))
    assert np.all(given_bounds.g_low[0, :2] < -1)
    assert np.all(given_bounds.g_low[force_gone:, :2] == -params.limits.friction_use)
    assert np.all(given_bounds.g_high[:, :2] == params.limits.friction_use)


@quick
@given(st.integers(0, 1000))
def test_dynamics_are_independent_of_where_the_map_begins(problem, numbers, seed):
    plan, given_numbers = numbers
    plan = wild(plan, seed)
    far = np.array(State(1000, -500, 0, 0, 0, 0, 0, 0, 0))
    here = problem.dynamics(plan.X[3], plan.U[3], given_numbers.P[3]).full().ravel()
    there = problem.dynamics(plan.X[3] + far, plan.U[3], given_numbers.P[3]).full().ravel()
    assert there == pytest.approx(here + far, abs=1e-9)


@pytest.mark.parametrize('name', ['mpcc', 'frenet'])
def test_a_mover_is_given_more_room_the_later_the_stage(world, scene, name):
    """Exactly growth times time; what stands, and stage 0, stay as they are."""
    moving, standing = Obstacle(1, 60.0, 0.0, 1.0, 3.0, 0.0), Obstacle(2, 90.0, 2.0, 1.5, 0.0, 0.0)
    scene = scene._replace(obstacles=Obstacles(0, (moving, standing)))
    radii = []
    for growth in (None, 0.4):
        params, vehicle = world.load(name, safety__growth_mps=growth)
        form = formulation.make(params, stage_parameters.car(params, vehicle))
        x0 = State(20.0, 0.2, 0.05, 20.0, 0.3, 0.1, 20.0, 0.01, -500.0)
        plan = guesses.from_path(scene.path, x0, form.car, N, DT)
        P = form.stage_parameters(scene, plan.X).P
        names = ocp.build(form.ocp, N, DT).parameters
        radii.append([P[:, names.index(f'obstacles.{i}.r_obs')] for i in (0, 1)])
    (moving_as_is, standing_as_is), (grown, unchanged) = radii
    assert grown - moving_as_is == pytest.approx(0.4 * DT * np.arange(N + 1))
    assert np.array_equal(standing_as_is, unchanged)


@pytest.mark.parametrize('growth', [None, 0.4])
def test_plans_are_judged_by_the_distances_of_the_problem(world, scene, growth):
    moving, standing = Obstacle(1, 60.0, 0.0, 1.0, 3.0, 0.0), Obstacle(2, 90.0, 2.0, 1.5, 0.0, 0.0)
    scene = scene._replace(obstacles=Obstacles(0, (moving, standing)))
    params, vehicle = world.load(safety__growth_mps=growth)
    form = formulation.make(params, stage_parameters.car(params, vehicle))
    x0 = State(20.0, 0.2, 0.05, 20.0, 0.3, 0.1, 20.0, 0.01, -500.0)
    plan = guesses.from_path(scene.path, x0, form.car, N, DT)
    in_problem = PlanEvaluator(form.ocp).evaluate(plan, form.stage_parameters(scene, plan.X).P).v2o
    judged = ways.least_gaps(plan.X, scene, params)
    assert judged == pytest.approx([np.min(D) for D in in_problem[:2]], abs=1e-3)


def test_the_safety_distance_to_edges_fits_a_narrow_road(world, scene):
    """3 m, then 1.2 m beside the middle of the road: there 0.1 m are left beside a car of 1.1 m."""
    X = np.array([0.0, 30.0, 31.0, 150.0])
    narrow = np.array([3.0, 3.0, 1.2, 1.2])
    edges = RoadEdges(0, np.column_stack([X, narrow]), np.column_stack([X, -narrow]))
    scene = scene._replace(road=road_edges.build(edges))
    columns = []
    for fits in (None, True):
        params, vehicle = world.load(safety__fit_edges=fits)
        form = formulation.make(params, stage_parameters.car(params, vehicle))
        x0 = State(5.0, 0.0, 0.0, 20.0, 0.0, 0.0, 5.0, 0.0, 0.0)
        plan = guesses.from_path(scene.path, x0, form.car, N, DT)
        P = form.stage_parameters(scene, plan.X).P
        names = list(ocp.build(form.ocp, N, DT).parameters)
        at_edge = names.index('D_sft.e')
        columns.append(P[:, at_edge].copy())
        columns.append(np.delete(P, at_edge, axis=1))
    constant, others, fitted, same = columns
    assert np.all(constant == 0.5)
    x = 5.0 + 20.0 * DT * np.arange(N + 1)
    assert np.all(fitted[x < 25.0] == 0.5)
    np.testing.assert_allclose(fitted[x > 33.0], 0.1, atol=1e-9)
    np.testing.assert_array_equal(others, same)
