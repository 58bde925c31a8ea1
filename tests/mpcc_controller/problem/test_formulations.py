"""The problems: cost, constraints and numbers of the stages, against numbers made by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller import in_force
from mpcc_controller.driving import ways
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Input, State
from mpcc_controller.parameters import INTEGRATED
from mpcc_controller.path import reference_path, road_edges
from mpcc_controller.problem import bounds, frenet_formulation, ocp, stage_parameters
from mpcc_controller.problem.frenet_formulation import FrenetState
from mpcc_controller.problem.obstacle_motion import Course, PredictedObstacle
from msgs_yaml.types import Obstacles, RoadEdges
from node_runtime.parameters import ParameterError
from stage_solver.solution import SOLVED
from stage_solver.stage_problem import Plan

quick = settings(max_examples=30)
N, DT = 50, 0.05
START = State(20.0, 0.2, 0.05, 20.0, 0.3, 0.1, 20.0, 0.01, -500.0)
SWERVING = State(40.2, 0.6, 0.15, 20.0, 0.7, 0.2, 40.2, 0.02, -500.0)
SPREADS = {
    'mpcc': State(2, 3, 0.2, 4, 1, 0.5, 2, 0.2, 5000),
    'frenet': FrenetState(2, 2, 0.2, 4, 1, 0.5, 0.2, 5000),
}
both = pytest.mark.parametrize('name', ['mpcc', 'frenet'])
MOVING = PredictedObstacle(1, 60.0, 0.0, 1.0, 3.0, 0.5)
STANDING = PredictedObstacle(2, 90.0, 2.0, 1.5, 0.0, 0.0)


def with_obstacles(scene, *obstacles):
    return scene._replace(obstacles=Obstacles(0, obstacles))


def wild(plan, spread, seed):
    """Return a plan that visits obstacles, edges and both signs of everything."""
    random = np.random.default_rng(seed)
    X = plan.X + random.uniform(-1, 1, plan.X.shape) * spread
    return Plan(X, plan.U + random.uniform(-1, 1, plan.U.shape) * Input(0.4, 2e4, 0.2, 0.5))


@both
def test_the_objective_is_the_sum_of_the_logged_terms(pose, name):
    posed = pose(START, name, drives=True)
    problem, P = posed.problem(), posed.numbers.P

    @quick
    @given(st.integers(0, 1000))
    def check(seed):
        plan = wild(posed.plan, SPREADS[name], seed)
        cost = float(problem.terminal_cost(plan.X[-1], P[-1]))
        cost += problem.stage_cost.map(N)(plan.X[:-1].T, plan.U.T, P[:-1].T).full().sum()
        logged = sum(np.sum(term) for term in posed.values(plan).costs)
        assert logged == pytest.approx(cost, rel=1e-12)

    check()


def test_weights_are_one_over_the_squared_tolerances(pose):
    weights = pose(
        START,
        tolerances__contouring_m=0.3,
        tolerances__lag_m=0.5,
        tolerances__steer_rate_radps=0.349,
        tolerances__force_rate_nps=2e4,
        priorities__obstacle=700.0,
        priorities__edge=30.0,
    ).form.constants['weights']
    assert weights.con == pytest.approx(1 / 0.09)
    assert weights.lag == pytest.approx(4)
    assert weights.d_delta == pytest.approx(8.2, rel=2e-3)
    assert weights.d_Fx * 1e6 == pytest.approx(1 / 400)
    assert (weights.v2o, weights.v2e) == (700, 30)


@pytest.mark.parametrize(
    ('name', 'errors'),
    [
        ('mpcc', {'con': 0.4**2, 'lag': 1.0}),
        ('frenet', {'e': 0.4**2, 'dpsi': 0.1**2}),
        ('tracking', {'con': 0.4**2}),
    ],
)
def test_errors_on_the_straight_before_the_lane_change_are_those_of_the_paper(
    pose, still, car, name, errors
):
    x = still(X=21.0, Y=0.4, psi=0.1, vx=18.0, theta=20.0)
    posed = pose(x, name).errors(Input(0.1, 2000.0, 0.6, 0.2))
    ideal = car.l_r / (car.l_f + car.l_r)
    errors |= {'d_delta': 0.01, 'd_Fx': 2000.0**2, 'lambda_b': (0.6 - ideal) ** 2, 'slack': 0.04}
    errors |= {'vel': 4.0, 'v2o': 0.0, 'v2e': 0.0, 'slow': 0.0}
    for key, value in errors.items():
        assert posed[key] == pytest.approx(value, rel=1e-3, abs=1e-12), key


@pytest.mark.parametrize('offsets', [(0.0,), (-1.1, 1.1)])
def test_every_circle_counts_against_every_obstacle_and_edge(pose, still, offsets):
    errors = pose(still(X=71.0, Y=4.9, theta=71.0), body__circle_offsets_m=offsets).errors()
    D_o = [np.hypot(71.0 + o - 72.0, 4.9 - 1.5) - 2.1 for o in offsets]
    D_e = 6.0 - 4.9 - 1.1

    def cost(D, D_sft):
        q = 1 if D < 0 else np.exp(-2 * D**2 / D_sft**2) if D_sft >= D else 0
        return q * (D - D_sft) ** 2

    assert errors['v2o'] == pytest.approx(sum(cost(D, 0.5) for D in D_o), abs=1e-5)
    assert errors['v2e'] == pytest.approx(len(offsets) * cost(D_e, 0.5), abs=1e-6)


@both
def test_constraints_are_the_papers_per_axle_and_for_the_road(pose, still, car, name):
    x = still(X=20.0, Y=3.0, theta=20.0, Fx=-8000.0)
    values = pose(x, name).constraints(Input(0, 0, 0.7, 0.25))
    Fz = single_track.loads(-8000.0, car)
    assert float(values.front) == pytest.approx(-5600 / (car.mu_f * Fz.f))
    assert float(values.rear) == pytest.approx(-2400 / (car.mu_r * Fz.r))
    # the road reaches from -2.5 to 6: its centre is 1.75, its half 4.25, the car's circle 1.1
    (beyond,) = values.track
    assert float(beyond) == pytest.approx(3.0 - 1.75 - (4.25 - 1.1) - 0.25, abs=1e-3)


@both
@pytest.mark.parametrize(
    ('vx', 'beyond', 'cost'), [(6.0, -0.5, 1.0), (8.0, 1.0, 1.0), (8.0, -0.5, 0.0), (6.0, 1.0, 2.0)]
)
def test_a_slow_car_may_not_leave_the_road_for_nothing(pose, still, name, vx, beyond, cost):
    """What it costs to be slow and off the road is the sum of what either costs."""
    Y = 1.75 + (4.25 - 1.1) + beyond  # from the middle of the road
    posed = pose(still(X=20.0, Y=Y, vx=vx, theta=20.0), name)
    slack = max(float(posed.constraints().track[0]), 0.0)
    errors = posed.errors(Input(0, 0, 0.5, slack))
    assert errors['slack'] + errors['slow'] == pytest.approx(cost, rel=0.01)


@both
@pytest.mark.parametrize('ahead', [1, -1], ids=['nose', 'tail'])
def test_the_outline_stays_on_the_track(world, pose, still, name, ahead):
    """A car of three circles whose CoG is well on the road and an end of it is not."""
    params, vehicle = world.load(name, body__circles=3)
    params = in_force.in_force(params, vehicle)
    outline, yaw = vehicle.outline, 0.4 * ahead
    end = outline.front_m if ahead > 0 else outline.rear_m
    for beyond in (0.3, -0.1):
        # the end, as wide as the car, is so far beyond the left edge
        Y = 6.0 + beyond - outline.width_m / 2 - end * np.sin(abs(yaw))
        posed = pose(still(X=20.0, Y=Y, psi=yaw, theta=20.0), name, params=params)
        assert max(posed.constraints().track) == pytest.approx(beyond, abs=0.01)


def test_of_many_obstacles_those_nearest_to_the_plan_count_and_empty_slots_cost_nothing(
    pose, scene
):
    crowd = with_obstacles(
        scene, *(PredictedObstacle(i, 20.0, 3.0 * i, 1.0, 0, 0) for i in range(9, 0, -1))
    )
    posed = pose(START, scene=crowd, drives=True)
    assert [o.id for o in posed.numbers.obstacles] == [1, 2, 3, 4]
    free = pose(START, scene=with_obstacles(scene), drives=True)
    assert np.all(free.values(wild(free.plan, SPREADS['mpcc'], 1)).costs.v2o == 0)


T = DT * np.arange(N + 1)
# it turns to the left, and what is known of it fades
TURNING = Course(DT, np.array([[60.0 + 3.0 * T], [0.5 * T**2], [0.4 * T]]), 0)


@both
def test_an_obstacle_is_in_the_problem_where_and_as_large_as_it_is_predicted(pose, scene, name):
    crowd = with_obstacles(scene, MOVING, MOVING._replace(course=TURNING), STANDING)
    posed = pose(START, name, crowd, drives=True)
    assert np.all(posed.column('obstacles.0.r_obs') == MOVING.r_obs)
    assert posed.column('obstacles.1.r_obs') == pytest.approx(MOVING.r_obs + 0.4 * T)
    assert np.all(posed.column('obstacles.2.r_obs') == STANDING.r_obs)
    if name == 'mpcc':
        for slot, Y in enumerate((0.5 * T, 0.5 * T**2)):
            assert posed.column(f'obstacles.{slot}.X') == pytest.approx(60.0 + 3.0 * T)
            assert posed.column(f'obstacles.{slot}.Y') == pytest.approx(Y)


def test_plans_are_judged_by_the_distances_of_the_problem(pose, scene):
    crowd = with_obstacles(scene, MOVING._replace(course=TURNING), STANDING)
    posed = pose(START, scene=crowd, drives=True)
    judged = ways.least_gaps(posed.plan.X, crowd, posed.form.params)
    assert judged == pytest.approx([np.min(D) for D in posed.values().v2o[:2]], abs=1e-3)


def test_of_more_discs_than_slots_the_closest_of_each_stage_have_a_place(pose, scene, world):
    """A column of 24 m: the four discs beside the car differ along it; none is far from a place."""
    column = [PredictedObstacle(7, 20.0 + 2.0 * k, 4.0, 1.0, 0.0, 0.0) for k in range(12)]
    far = PredictedObstacle(8, 20.0, 500.0, 1.0, 0.0, 0.0)
    params, _ = world.load()
    params = replace(params, tracker=replace(params.tracker, position_m=0.1))
    posed = pose(START, scene=with_obstacles(scene, far, *column), drives=True, params=params)
    x = State(*posed.plan.X.T)
    apart = np.array([np.hypot(o.X - x.X, o.Y - x.Y) for o in (far, *column)])
    closest = np.sort(np.argsort(apart, axis=0)[:4], axis=0)
    assert np.all(np.sort(posed.numbers.places, axis=0) == closest)
    for slot in range(4):
        held = [(far, *column)[k].X for k in posed.numbers.places[slot]]
        assert posed.column(f'obstacles.{slot}.X') == pytest.approx(held)
    values = posed.values()
    [(key, D, _)] = stage_parameters.by_object(posed.numbers, values.v2o, values.priority_o)
    radii = column[0].r_obs + params.body.circle_radius_m
    assert key == 7
    assert pytest.approx(np.min(apart, axis=0) - radii, abs=1e-3) == D


def test_the_safety_distance_to_edges_fits_a_narrow_road(pose, still, scene):
    """3 m, then 1.2 m beside the middle of the road: there 0.1 m are left beside a car of 1.1 m."""
    X, narrow = np.array([0.0, 30.0, 31.0, 150.0]), np.array([3.0, 3.0, 1.2, 1.2])
    edges = RoadEdges(0, np.column_stack([X, narrow]), np.column_stack([X, -narrow]))
    scene, x = scene._replace(road=road_edges.build(edges)), still(X=5.0, theta=5.0)
    constant, fitted = (
        pose(x, scene=scene, drives=True, safety__fit_edges=fits) for fits in (None, True)
    )
    assert np.all(constant.column('D_sft.e') == 0.5)
    along = 5.0 + 20.0 * DT * np.arange(N + 1)
    assert np.all(fitted.column('D_sft.e')[along < 25.0] == 0.5)
    assert fitted.column('D_sft.e')[along > 33.0] == pytest.approx(0.1, abs=1e-9)
    differs = np.any(constant.numbers.P != fitted.numbers.P, axis=0)
    assert np.array(fitted.problem().parameters)[differs].tolist() == ['D_sft.e']


@both
def test_friction_bounds_are_the_share_of_the_parameters_for_the_states_of_a_formulation(
    pose, name
):
    form = pose(START, name).form
    state, limits = form.ocp.state, form.params.limits
    given_bounds = bounds.build(limits, form.car, START._replace(Fx=-3000.0), N, DT, state)
    assert np.all(given_bounds.g_high[:, :2] == limits.friction_use)
    assert np.all(given_bounds.h_low == -limits.friction_use)
    for side, rows in ((-1, given_bounds.x_low), (1, given_bounds.x_high)):
        x = state(*rows[3])
        assert x.delta == side * limits.steer_rad
        assert x.Fx == (limits.drive_n if side > 0 else -limits.brake_n)
        assert np.sum(np.isfinite(x)) == 2
    rates = limits.steer_rate_radps, limits.force_rate_nps
    split = limits.brake_front_share_min, limits.brake_front_share_max
    assert given_bounds.u_high[3].tolist() == [*rates, split[1], np.inf]
    assert given_bounds.u_low[3].tolist() == [-rates[0], -rates[1], split[0], -np.inf]


@quick
@given(
    Fx=st.floats(-24000.0, 12000.0),
    delta=st.floats(-1.0, 1.0),
    friction=st.floats(0.05, 1.5),
    lambda_d=st.floats(0.0, 1.0),
    split=st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)).map(sorted),
    drive_use=st.one_of(st.none(), st.floats(0.1, 1.0)),
)
def test_whatever_the_force_on_whatever_road_there_is_a_plan(
    world, Fx, delta, friction, lambda_d, split, drive_use
):
    """Force and angle fall as fast as they may; some split within its bounds overloads no axle."""
    params, vehicle = world.load(
        model__friction=friction,
        model__drive_front_share=lambda_d,
        limits__brake_front_share_min=split[0],
        limits__brake_front_share_max=split[1],
        limits__drive_friction_use=drive_use,
    )
    limits, car = params.limits, stage_parameters.car(params, vehicle)
    given_bounds = bounds.build(limits, car, START._replace(Fx=Fx, delta=delta), N, DT)
    falls = [
        np.copysign(np.maximum(abs(value) - rate * DT * np.arange(N + 1), 0), value)
        for value, rate in ((delta, limits.steer_rate_radps), (Fx, limits.force_rate_nps))
    ]
    for i, fall in zip((State._fields.index('delta'), State._fields.index('Fx')), falls):
        assert np.all(given_bounds.x_low[:, i] <= fall)
        assert np.all(fall <= given_bounds.x_high[:, i])
    for k, force in enumerate(falls[1]):
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
    car, start = stage_parameters.car(params, vehicle), START._replace(Fx=Fx)
    given_bounds = bounds.build(params.limits, car, start, N, DT)
    force_gone = int(np.ceil(-Fx / params.limits.force_rate_nps / DT))
    assert np.all(given_bounds.g_low[0, :2] < -1)
    assert np.all(given_bounds.g_low[force_gone:, :2] == -params.limits.friction_use)
    assert np.all(given_bounds.g_high[:, :2] == params.limits.friction_use)


@both
def test_a_cold_start_finds_the_plan_of_fatrop(pose, roads, name):
    road = with_obstacles(roads['straight'], STANDING._replace(X=40.0, Y=1.9, r_obs=1.0))
    start = State(0.0, 0.0, 0.0, 20.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    posed = pose(start, name, road, drives=True)
    solution, reference = posed.solve(), posed.solve('fatrop')
    assert solution.status == reference.status == SOLVED
    assert solution.cost == pytest.approx(reference.cost, rel=1e-5)
    assert np.allclose(solution.plan.X, reference.plan.X, rtol=1e-4, atol=1e-2)


@pytest.mark.parametrize(('name', 'dt', 'accuracy'), [('mpcc', DT, 1e-9), ('frenet', 1e-3, 2e-6)])
def test_the_formulations_move_the_same_car(pose, scene, car, name, dt, accuracy):
    """The baseline agrees after 1 ms in the bend to what RK2 leaves of a third power."""
    u = np.array(Input(0.3, -2e4, 0.6, 0.0))
    for X in pose(SWERVING, drives=True).plan.X[5:30:10]:
        posed = pose(State(*X), name)
        dynamics = ocp.build(posed.form.ocp, N, dt).dynamics
        after = dynamics(posed.plan.X[0], u, posed.numbers.P[0]).full().ravel()
        moved = single_track.step(dt)(X, u, car).full().T
        there = posed.form.to_local(Plan(moved, u[None]), scene.path).X[0]
        assert after == pytest.approx(there, abs=accuracy)


@both
def test_the_use_of_the_friction_is_that_of_the_forces_of_the_tyres(pose, car, name):
    u = Input(0.0, 0.0, 0.5, 0.0)
    use = pose(SWERVING, name).values().friction
    F, Fz = single_track.tyre_forces(SWERVING, u, car), single_track.loads(SWERVING.Fx, car)
    assert use.f[0] == pytest.approx(np.hypot(F.F_xf, F.F_yf) / (car.mu_f * Fz.f))
    assert use.r[0] == pytest.approx(np.hypot(F.F_xr, F.F_yr) / (car.mu_r * Fz.r))


@pytest.fixture(scope='module')
def swerve(pose):
    """Return a drive through the lane change, beside the path, as a plan in the map."""
    plan = pose(SWERVING, drives=True).plan
    return plan._replace(X=plan.X + State(0.2, -0.5, 0.1, 0, 0.4, 0, 0, 0, 0))


def test_a_plan_in_path_coordinates_and_back_is_the_same_whatever_its_turns(pose, scene, swerve):
    form, path = pose(START, 'frenet').form, scene.path
    turned = swerve._replace(X=swerve.X + State(0, 0, 2 * np.pi, 0, 0, 0, 0, 0, 0))
    inside, again = (form.to_local(plan, path) for plan in (swerve, turned))
    assert pytest.approx(inside.X, abs=1e-9) == again.X
    outside = form.to_map(inside, path)
    assert outside.X[:, :6] == pytest.approx(swerve.X[:, :6], abs=1e-9)
    assert outside.U is swerve.U
    inside.X[7:] = np.nan
    broken = form.to_map(inside, path).X
    assert np.isnan(broken[7:, 0]).all()
    assert np.isfinite(broken[:7]).all()


def test_the_frame_turns_along_a_guess_as_the_path_does(scene, swerve):
    arcs, _ = reference_path.arcs_at(scene.path, State(*swerve.X.T).theta)
    turned = np.sum(frenet_formulation.mean_curvatures(arcs)[:-1] * np.diff(arcs.theta))
    assert turned == pytest.approx(arcs.psi[-1] - arcs.psi[0], abs=1e-12)
    standing = type(arcs)(*(np.repeat(column[9:10], 5) for column in arcs))
    curvatures = frenet_formulation.mean_curvatures(standing)
    assert curvatures == pytest.approx(np.repeat(arcs.kappa[9:10], 5))


@pytest.mark.parametrize(
    ('name', 'changes', 'message'),
    [
        ('frenet', {'formulation__distance': 'cartesian'}, 'formulation: frenet'),
        ('frenet', {'formulation__lag': True}, 'formulation: frenet'),
        ('frenet', {'safety__fit_edges': True}, 'safety.fit_edges: is true, but frenet'),
        ('frenet', {'surroundings__align_track': True}, 'surroundings.align_track: is true'),
        ('frenet', {'model__theta': INTEGRATED}, 'model.theta: .* of frenet begin where the car'),
        ('tracking', {'model__theta': INTEGRATED}, 'model.theta: .* allowed with it: projected'),
    ],
)
def test_options_that_a_formulation_does_not_have_are_refused(pose, name, changes, message):
    with pytest.raises(ParameterError, match=message):
        pose(START, name, **changes)


def test_trackings_reference_starts_at_the_car_and_moves_at_the_desired_speed(pose, still):
    posed = pose(still(X=10.0, Y=0.4, vx=5.0, theta=10.0), 'tracking')
    stages, t = posed.numbers.stages, DT * np.arange(N + 1)
    assert stages.path.theta == pytest.approx(10.0 + 20.0 * t, abs=1e-4)
    assert stages.v_ref == pytest.approx(np.full(N + 1, 20.0), abs=1e-3)
    # the lane change begins at 45 m: up to there the path is the x axis, whatever theta is
    values = posed.values(posed.plan._replace(X=posed.plan.X + still(vx=0.0, theta=3.0)))
    assert values.tracking.lag[:35] == pytest.approx(20.0 * t[:35], abs=1e-6)
    assert values.tracking.con[:35] == pytest.approx(0.4)
