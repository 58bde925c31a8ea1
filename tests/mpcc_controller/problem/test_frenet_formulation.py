"""The baseline's problem: cost, limits, motion, and its conversion to the map and back."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.driving import guesses
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Input, State
from mpcc_controller.path import reference_path
from mpcc_controller.problem import bounds, cost_terms, formulation, frenet_formulation, ocp
from mpcc_controller.problem.frenet_formulation import FrenetState
from mpcc_controller.problem.plan_evaluator import PlanEvaluator
from node_runtime import named_vector
from stage_solver.stage_problem import Plan

quick = settings(max_examples=30)
N, DT = 50, 0.05


@pytest.fixture(scope='module')
def baseline(world):
    params, _ = world.load('frenet')
    return params


@pytest.fixture(scope='module')
def frenet(baseline, car):
    return formulation.make(baseline, car)


@pytest.fixture(scope='module')
def swerve(scene, car):
    """Return a drive through the lane change, beside the path, as a plan in the map."""
    x0 = State(40.0, 0.6, 0.15, 20.0, 0.3, 0.2, 40.0, 0.02, -500.0)
    plan = guesses.from_path(scene.path, x0, car, N, DT)
    return plan._replace(X=plan.X + np.array(State(0.2, -0.5, 0.1, 0, 0.4, 0, 0, 0, 0)))


def test_weights_and_errors_have_the_same_names(frenet):
    formula = frenet.ocp
    numeric = named_vector.build(
        formula.template, [1.0] * len(named_vector.leaves(formula.template))
    )
    errors = formula.errors(FrenetState(*[0.5] * 8), Input(*[0.5] * 4), numeric)
    assert set(errors) == set(numeric.weights._fields)


def test_common_weights_are_those_of_the_mpcc(world, baseline, params):
    mine = cost_terms.weights(cost_terms.in_use(cost_terms.FRENET, baseline), baseline)
    others = cost_terms.weights(cost_terms.PAPER, params)
    assert mine.e == others.con
    assert mine.dpsi == pytest.approx(1 / np.radians(10) ** 2, rel=0.01)
    for name in set(mine._fields) - {'e', 'dpsi'}:
        assert getattr(mine, name) == getattr(others, name), name


def test_only_formulation_differs_from_the_configuration_of_the_mpcc(baseline, params):
    assert vars(baseline) | {'formulation': None} == vars(params) | {'formulation': None}


def test_errors_by_hand_on_the_straight_before_the_lane_change(car, scene, frenet):
    x = State(20.0, 0.4, 0.1, 18.0, 0.0, 0.0, 20.0, 0.0, 0.0)
    plan = Plan(np.tile(x, (N + 1, 1)), np.zeros((N, 4)))
    numbers = frenet.stage_parameters(scene, plan.X)
    stage = named_vector.build(numbers.stages, numbers.P[0])
    inside = FrenetState(*frenet_formulation.plan_to_frenet(plan, scene.path).X[0])
    errors = frenet.ocp.errors(inside, Input(0.1, 2e3, 0.6, 0.2), stage)
    assert float(errors['e']) == pytest.approx(0.4**2)
    assert float(errors['dpsi']) == pytest.approx(0.1**2)
    assert float(errors['vel']) == pytest.approx((18 - 20) ** 2, rel=1e-3)
    assert float(errors['lambda_b']) == pytest.approx((0.6 - car.l_r / (car.l_f + car.l_r)) ** 2)
    assert (float(errors['v2o']), float(errors['v2e'])) == (0, 0)


def test_the_track_limit_is_the_road_less_the_circle(car, scene, frenet):
    x = State(20.0, 3.0, 0.0, 20.0, 0.0, 0.0, 20.0, 0.0, -8000.0)
    plan = Plan(np.tile(x, (N + 1, 1)), np.zeros((N, 4)))
    numbers = frenet.stage_parameters(scene, plan.X)
    stage = named_vector.build(numbers.stages, numbers.P[0])
    inside = FrenetState(*frenet_formulation.plan_to_frenet(plan, scene.path).X[0])
    values = frenet.ocp.constraints(inside, Input(0, 0, 0.7, 0.25), stage)
    # the road reaches from -2.5 to 6: its centre is 1.75, its half 4.25, the car's circle 1.1
    (beyond,) = values.track
    assert float(beyond) == pytest.approx(3.0 - 1.75 - (4.25 - 1.1) - 0.25, abs=1e-3)
    Fz = single_track.loads(-8000.0, car)
    assert float(values.front) == pytest.approx(-5600 / (car.mu_f * Fz.f))


@quick
@given(st.integers(0, 1000))
def test_the_objective_is_the_sum_of_the_logged_terms(scene, swerve, frenet, seed):
    formula = frenet.ocp
    numbers = frenet.stage_parameters(scene, swerve.X)
    plan = frenet_formulation.plan_to_frenet(swerve, scene.path)
    random = np.random.default_rng(seed)
    spread = FrenetState(2, 2, 0.2, 4, 1, 0.5, 0.2, 5000)
    plan = plan._replace(X=plan.X + random.uniform(-1, 1, plan.X.shape) * spread)
    problem = ocp.build(formula, N, DT)
    cost = float(problem.terminal_cost(plan.X[-1], numbers.P[-1]))
    stage_costs = problem.stage_cost.map(N)(plan.X[:-1].T, plan.U.T, numbers.P[:-1].T)
    cost += stage_costs.full().sum()
    terms = PlanEvaluator(formula).evaluate(plan, numbers.P).costs
    assert sum(np.sum(term) for term in terms) == pytest.approx(cost, rel=1e-12)


def test_both_formulations_move_the_same_car(car, scene, swerve, frenet):
    """After 1 ms through the bend they agree to what RK2 leaves of a third power."""
    dt = 1e-3
    numbers = frenet.stage_parameters(scene, swerve.X)
    problem = ocp.build(frenet.ocp, N, dt)
    motion = single_track.step(dt)
    u = np.array(Input(0.3, -2e4, 0.6, 0.0))
    before = frenet_formulation.plan_to_frenet(swerve, scene.path).X
    for k in (5, 15, 25):
        piece, _ = reference_path.arcs_at(scene.path, before[k : k + 1, 0])
        stage = named_vector.build(numbers.stages, numbers.P[k])._replace(kappa=piece.kappa[0])
        after = problem.dynamics(before[k], u, np.array(named_vector.leaves(stage))).full().ravel()
        moved = motion(swerve.X[k], u, np.array(car)).full().T
        there = frenet_formulation.plan_to_frenet(Plan(moved, u[None]), scene.path).X[0]
        assert after == pytest.approx(there, abs=2e-6)


def test_conversion_of_a_plan_to_the_map_and_back_is_the_identity(scene, swerve):
    inside = frenet_formulation.plan_to_frenet(swerve, scene.path)
    outside = frenet_formulation.plan_to_map(inside, scene.path)
    again = frenet_formulation.plan_to_frenet(outside, scene.path)
    assert outside.X[:, :6] == pytest.approx(swerve.X[:, :6], abs=1e-9)
    assert pytest.approx(inside.X, abs=1e-9) == again.X
    assert outside.U is swerve.U


def test_a_heading_one_turn_away_is_the_same_heading(scene, swerve):
    turned = swerve._replace(X=swerve.X + np.array(State(0, 0, 2 * np.pi, 0, 0, 0, 0, 0, 0)))
    here, there = (
        frenet_formulation.plan_to_frenet(plan, scene.path).X for plan in (swerve, turned)
    )
    assert here == pytest.approx(there, abs=1e-9)


def test_the_frame_turns_along_a_guess_as_the_path_does(scene, swerve):
    x = State(*swerve.X.T)
    arcs, _ = reference_path.arcs_at(scene.path, x.theta)
    turned = np.sum(frenet_formulation.mean_curvatures(arcs)[:-1] * np.diff(arcs.theta))
    assert turned == pytest.approx(arcs.psi[-1] - arcs.psi[0], abs=1e-12)
    standing = frenet_formulation.mean_curvatures(
        type(arcs)(*(np.repeat(c[9:10], 5) for c in arcs))
    )
    assert standing == pytest.approx(np.repeat(arcs.kappa[9:10], 5))


def test_a_plan_that_is_not_finite_stays_not_finite_in_the_map(scene, swerve):
    broken = frenet_formulation.plan_to_frenet(swerve, scene.path)
    broken.X[7:] = np.nan
    left = frenet_formulation.plan_to_map(broken, scene.path)
    assert np.isnan(left.X[7:, 0]).all()
    assert np.isfinite(left.X[:7]).all()


def test_bounds_hold_the_same_quantities(baseline, car):
    inside = bounds.build(baseline.limits, car, -500.0, N, DT, FrenetState)
    outside = bounds.build(baseline.limits, car, -500.0, N, DT)
    for name in ('delta', 'Fx'):
        mine = inside.x_high[:, FrenetState._fields.index(name)]
        assert np.array_equal(mine, outside.x_high[:, State._fields.index(name)])
    assert np.isinf(inside.x_high).sum(axis=1).max() == len(FrenetState._fields) - 2
    for name in set(inside._fields) - {'x_low', 'x_high'}:
        assert np.array_equal(getattr(inside, name), getattr(outside, name)), name


@pytest.mark.parametrize('wrong', [{'distance': 'cartesian'}, {'lag': True}])
def test_the_baseline_rejects_the_formulation_parameters_of_the_mpcc(world, car, wrong):
    params, _ = world.load('frenet', **{f'formulation__{k}': v for k, v in wrong.items()})
    with pytest.raises(formulation.ParameterError, match='formulation: frenet'):
        formulation.make(params, car)


@pytest.mark.parametrize('name', ['safety__fit_edges', 'surroundings__align_track'])
def test_the_baseline_has_no_track_whose_centre_could_be_moved(world, car, name):
    params, _ = world.load('frenet', **{name: True})
    with pytest.raises(formulation.ParameterError, match=name.replace('__', '.')):
        formulation.make(params, car)
