"""Exchangeable terms of the MPCC's cost: what each changes, and what it leaves unchanged."""

import numpy as np
import pytest

from mpcc_controller.driving import initial_guess
from mpcc_controller.driving.controller import Controller
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import FORMULATIONS
from mpcc_controller.path import reference_path, road_edges
from mpcc_controller.problem import formulation, ocp, stage_parameters
from mpcc_controller.problem.plan_evaluator import PlanEvaluator
from mpcc_controller.problem.stage_parameters import Scene

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
    plan = initial_guess.guess_from_path(scene.path, x0, car, N, DT)
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
