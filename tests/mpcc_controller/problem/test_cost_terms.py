"""Exchangeable terms of the MPCC's cost: what each changes, and what it leaves unchanged."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.driving import guesses
from mpcc_controller.driving.controller import Controller
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import FORMULATIONS
from mpcc_controller.path import reference_path, road_edges
from mpcc_controller.problem import formulation, ocp, stage_parameters
from mpcc_controller.problem.plan_evaluator import PlanEvaluator
from mpcc_controller.problem.stage_parameters import Scene
from node_runtime import named_vector

D_SFT = 0.5
N, DT = 50, 0.05


def pose_problem(world, situation, controller='mpcc', **changes):
    """Return the evaluator of plans, a plan along the path, and its stage parameters."""
    changed = {f'formulation__{name}': value for name, value in changes.items()}
    params, vehicle = world.load(controller, **changed)
    scene = Scene(
        reference_path.build(situation.reference),
        road_edges.build(situation.edges),
        situation.obstacles,
    )
    car = stage_parameters.car(params, vehicle)
    x0 = State(50.0, 0.5, 0.05, 20.0, 0.0, 0.0, 50.0, 0.0, 0.0)
    plan = guesses.from_path(scene.path, x0, car, N, DT)
    form = formulation.make(params, car)
    numbers = form.stage_parameters(scene, plan.X)
    return PlanEvaluator(form.ocp), form.to_local(plan, scene.path), numbers.P


def evaluate(*given, **changes):
    """Return the evaluation of a plan along the path; see `pose_problem`."""
    evaluator, plan, P = pose_problem(*given, **changes)
    return evaluator.evaluate(plan, P)


def test_without_the_lag_error_only_its_cost_is_gone(world):
    paper, without = (evaluate(world, world.lane_change(), lag=lag) for lag in (True, False))
    assert paper.costs.lag.sum() > 0 == without.costs.lag.sum()
    assert without.tracking.lag == pytest.approx(paper.tracking.lag)
    for name in set(paper.costs._fields) - {'lag'}:
        assert np.array_equal(getattr(paper.costs, name), getattr(without.costs, name)), name


def test_with_the_heading_error_only_its_cost_is_added(world):
    paper, more = (evaluate(world, world.lane_change(), heading=on) for on in (False, True))
    assert set(more.costs._fields) - set(paper.costs._fields) == {'dpsi'}
    assert more.costs.dpsi.sum() > 0
    for name in paper.costs._fields:
        assert np.array_equal(getattr(paper.costs, name), getattr(more.costs, name)), name


def test_the_heading_error_costs_what_it_costs_the_baseline(world):
    headed = evaluate(world, world.lane_change(), heading=True)
    baseline = evaluate(world, world.lane_change(), controller='frenet', heading=True)
    # the first point is beside the path: the baseline projects it again, the MPCC uses theta
    assert headed.costs.dpsi[1:] == pytest.approx(baseline.costs.dpsi[1:], rel=2e-3, abs=1e-6)


def test_whole_turns_are_no_heading_error(world):
    evaluator, plan, P = pose_problem(world, world.lane_change(), heading=True)
    turned = plan._replace(X=plan.X + np.array(State(0, 0, -2 * np.pi, 0, 0, 0, 0, 0, 0)))
    once, again = (evaluator.evaluate(candidate, P).costs.dpsi for candidate in (plan, turned))
    assert again == pytest.approx(once, rel=1e-9, abs=1e-12)


def test_without_the_heading_error_the_baseline_loses_only_its_cost(world):
    with_it, without = (
        evaluate(world, world.lane_change(), controller='frenet', heading=on)
        for on in (True, False)
    )
    assert with_it.costs.dpsi.sum() > 0 == without.costs.dpsi.sum()
    for name in set(with_it.costs._fields) - {'dpsi'}:
        assert np.array_equal(getattr(with_it.costs, name), getattr(without.costs, name)), name


def test_along_a_straight_path_distances_are_those_on_the_ground(world):
    situation = world.straight(obstacles=world.lane_change().obstacles.items)
    ground, path = (evaluate(world, situation, distance=where) for where in ('cartesian', 'path'))
    for mine, other in zip(ground.v2o[:1] + ground.v2e, path.v2o[:1] + path.v2e):
        assert mine == pytest.approx(other, abs=1e-6)


def test_beside_a_bend_only_the_distances_change_with_the_measure(world):
    ground, path = (
        evaluate(world, world.lane_change(), distance=where) for where in ('cartesian', 'path')
    )
    assert 0.05 < np.abs(ground.v2o[0] - path.v2o[0]).max() < 1.0
    # across the path an edge is at most 1 / cos(heading) farther than where it is nearest
    assert np.all(path.v2e[0] > ground.v2e[0] - 1e-3)
    for name in set(ground.costs._fields) - {'v2o', 'v2e'}:
        assert np.array_equal(getattr(ground.costs, name), getattr(path.costs, name)), name


@pytest.mark.parametrize(
    ('change', 'same'),
    [
        ({'distance': 'path'}, False),
        ({'priority': 'step'}, False),
        ({'heading': True}, False),
        ({'lag': False}, True),
    ],
)
def test_a_rule_of_structure_is_another_problem_and_the_lag_is_a_number(
    world, vehicle, change, same
):
    def text(**changes):
        params, _ = world.load(**{f'formulation__{name}': v for name, v in changes.items()})
        symbolic = formulation.make(params, stage_parameters.car(params, vehicle)).ocp
        problem = ocp.build(symbolic, N, DT)
        return problem.stage_cost.serialize(), problem.parameters

    assert (text(**change) == text()) == same


def test_a_term_whose_tolerance_is_left_out_is_not_in_the_problem(world, vehicle):
    def names(**changes):
        params, _ = world.load(**changes)
        symbolic = formulation.make(params, stage_parameters.car(params, vehicle)).ocp
        return {term.name for term in symbolic.terms}

    assert names(tolerances__lateral_jerk_mps3=50.0) - names() == {'jerk'}


ENVELOPE = {
    'front_slip': 'front_slip_excess_rad',
    'rear_slip': 'rear_slip_excess_rad',
    'yaw_rate': 'yaw_rate_excess_radps',
}


@pytest.mark.parametrize(('term', 'tolerance'), ENVELOPE.items())
def test_a_soft_limit_is_in_the_problem_where_its_tolerance_is(world, vehicle, term, tolerance):
    def symbolic(**changes):
        params, _ = world.load(**changes)
        return formulation.make(params, stage_parameters.car(params, vehicle)).ocp

    paper, limited = symbolic(), symbolic(**{f'tolerances__{tolerance}': 0.01})
    assert {t.name for t in limited.terms} - {t.name for t in paper.terms} == {term}
    assert limited.template.envelope._fields == (term,)
    assert paper.template.envelope == ()


@settings(max_examples=40)
@given(
    st.floats(8, 40),
    st.floats(-10, 10),
    st.floats(-1.5, 1.5),
    st.floats(-0.45, 0.45),
    st.floats(0.3, 1.5),
)
def test_a_soft_limit_costs_the_square_of_what_is_beyond_it(limited, vx, vy, r, delta, share):
    car, squared = limited
    x = State(0.0, 0.0, 0.0, vx, vy, r, 0.0, delta, 0.0)
    g, wheelbase = 9.81, car.l_f + car.l_r
    front_load, rear_load = (car.m * g * arm / wheelbase for arm in (car.l_r, car.l_f))
    front = abs(np.arctan2(vy + car.l_f * r, vx) - delta)
    rear = abs(np.arctan2(vy - car.l_r * r, vx))
    grip = (car.mu_f * front_load + car.mu_r * rear_load) / car.m
    expected = {
        'front_slip': front - share * np.arctan(3 * car.mu_f * front_load / car.C_f),
        'rear_slip': rear - share * np.arctan(3 * car.mu_r * rear_load / car.C_r),
        'yaw_rate': abs(r) - share * grip / vx,
    }
    found = squared(x, share)
    for name, beyond in expected.items():
        # the controller rounds the speed at its least value: 1 % at 8 m/s
        assert np.sqrt(found[name]) == pytest.approx(max(beyond, 0.0), rel=0.02, abs=5e-3), name


@pytest.fixture(scope='module')
def limited(world, vehicle):
    """Return the car and (state, share) -> squared errors of the three soft limits by name."""
    params, _ = world.load(**{f'tolerances__{name}': 0.01 for name in ENVELOPE.values()})
    form = formulation.make(params, stage_parameters.car(params, vehicle))
    flat, x, _, p = ocp.symbols(form.ocp)
    errors = form.ocp.errors(x, None, p)
    function = ca.Function('errors', [flat[0], flat[2]], [errors[name] for name in ENVELOPE])
    names = named_vector.names(form.ocp.template)

    def squared(state, share):
        values = dict.fromkeys(names, 1.0)
        values |= {f'car.{name}': value for name, value in form.car._asdict().items()}
        values |= {f'envelope.{name}': share for name in ENVELOPE}
        return dict(zip(ENVELOPE, map(float, function(state, list(values.values())))))

    return form.car, squared


def test_the_front_slip_that_counts_is_that_of_the_angle_that_acts(world, vehicle):
    """The tyre has the slip of the lagging angle; the set-point runs ahead of it."""
    params, _ = world.load(tolerances__front_slip_excess_rad=0.01, model__servo_lag=True)
    form = formulation.make(params, stage_parameters.car(params, vehicle))
    flat, x, u, p = ocp.symbols(form.ocp)
    names = named_vector.names(form.ocp.template)
    values = dict.fromkeys(names, 1.0)
    values |= {f'car.{name}': value for name, value in form.car._asdict().items()}
    values['envelope.front_slip'] = 0.01

    def excess(delta, d_delta, has_input=True):
        errors = form.ocp.errors(x, u if has_input else None, p)
        function = ca.Function('error', flat, [errors['front_slip']])
        state = State(0.0, 0.0, 0.0, 20.0, 0.0, 0.0, 0.0, delta, 0.0)
        squared = function(state, [d_delta, 0.0, 0.6, 0.0], list(values.values()))
        return np.sqrt(float(squared))

    assert excess(0.1, 0.0) == pytest.approx(0.1, rel=0.05)
    lag = form.car.steer_lag
    assert excess(0.1 + 0.5 * lag, 0.5) == pytest.approx(excess(0.1, 0.0), rel=1e-9)
    assert excess(0.1, 0.5, has_input=False) == excess(0.1, 0.0)  # the last stage has no rate


def test_with_a_soft_limit_a_lane_change_keeps_the_rear_axle_below_it(world, vehicle):
    def peak_slip(**changes):
        controller = Controller(*world.load(**changes))
        run = world.drive(world.set_inputs(controller, world.lane_change(v=22.0)), 90)
        x = run.states
        return np.abs(np.arctan2(x.vy - controller.car.l_r * x.r, x.vx)).max(), controller.car

    paper, car = peak_slip()
    limit = 0.35 * float(single_track.sliding_slips(car).r)
    limited, _ = peak_slip(tolerances__rear_slip_excess_rad=0.01, envelope__rear_slip=0.35)
    assert limited < limit + 0.01 < paper


def test_the_lateral_jerk_term_makes_a_lane_change_smoother(world):
    def peak_jerk(**changes):
        controller = Controller(*world.load(**changes))
        run = world.drive(world.set_inputs(controller, world.lane_change()), 90)
        assert {why.values['rung'] for why in run.whys} <= {'solved', 'stopped_early'}
        return np.abs(np.diff(run.states.r * run.states.vx)).max() / DT

    paper, smooth = peak_jerk(), peak_jerk(tolerances__lateral_jerk_mps3=5.0)
    assert smooth < 0.8 * paper


@pytest.mark.parametrize('name', FORMULATIONS)
def test_the_formulation_that_the_parameters_name_is_made(name, world, vehicle):
    params, _ = world.load(name)
    made = formulation.make(params, stage_parameters.car(params, vehicle))
    assert type(made) is formulation.find(name)
    assert made.ocp.name == name
