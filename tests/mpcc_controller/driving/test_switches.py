"""Switches of the problem and of the solver: theta, arcs, brake split; one step, preparation."""

from itertools import pairwise

import numpy as np
import pytest

from mpcc_controller.driving import planner
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.path_progress import LOST_M
from mpcc_controller.driving.prediction_model import PredictionModel
from mpcc_controller.driving.records import TickInputs
from mpcc_controller.driving.tick_solvers import MOST_REFRESHES, REFRESH_FROM_M
from mpcc_controller.in_force import FRONT_SHARE
from mpcc_controller.model.single_track import State
from mpcc_controller.path import arc, reference_path
from msgs_yaml import conformance, encode
from msgs_yaml.types import VehicleState
from stage_solver.solution import FAILED, ONE_STEP, SOLVED

TICK_NS = 50_000_000
THETA = State._fields.index('theta')


@pytest.fixture
def changed(world):
    """Return a function that returns a controller with other parameters on a road."""

    def make(situation=None, name='mpcc', **changes):
        controller = Controller(*world.load(name, **changes))
        return world.set_inputs(controller, situation or world.lane_change())

    return make


def records(world, controller, ticks, speed=20.0):
    """Return the TickRecords of a closed loop with the prediction model as the car."""
    advance = world.make_car(controller.car)
    x = State(0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(ticks):
        record = controller.step(TickInputs(VehicleState(k * TICK_NS, *x[:6])))
        yield record
        x = advance(x, record.command)


# theta


def test_an_integrated_theta_is_the_distance_travelled_and_a_projected_one_that_along_the_path(
    world, changed
):
    """The distance by quadrature of the measured speed, that along the path by its projection."""
    beyond = {}
    for kind in ('integrated', 'projected'):
        controller = changed(model__theta=kind)
        run = list(records(world, controller, 90))
        speed = np.array([np.hypot(r.state.vx, r.state.vy) for r in run])
        theta = np.array([r.x0.theta for r in run])
        distance = np.concatenate(([0], np.cumsum((speed[1:] + speed[:-1]) / 2 * 0.05)))
        beyond[kind] = np.max(np.abs(theta - distance))
        foot = reference_path.project(controller.scene.path, run[-1].x0.X, run[-1].x0.Y, None, 10.0)
        assert (abs(theta[-1] - foot) < 1e-9) == (kind == 'projected')
        if kind == 'integrated':
            for before, record in pairwise(run):
                assert record.x0.theta == before.decision.plan.X[1, THETA]
            assert abs(controller.report(run[-1])[1].values['error.lag']) > 1e-3
    # a car that cuts the bends travels less than the path is long
    assert beyond['integrated'] < 2e-3
    assert beyond['projected'] > 2e-2


def test_a_late_state_has_the_theta_of_its_instant(world, changed):
    controller = changed(world.straight(), model__theta='integrated')
    first = controller.step(TickInputs(world.rolling(X=25.0)))
    late = controller.step(TickInputs(world.rolling(X=27.0, stamp_ns=2 * TICK_NS)))
    assert late.x0.theta == first.decision.plan.X[2, THETA]


@pytest.mark.parametrize('lost', ['plan', 'path', 'far'])
def test_an_integrated_theta_starts_from_the_projection_again_when_it_is_lost(world, changed, lost):
    situation = world.lane_change()
    controller = changed(situation, model__theta='integrated')
    list(records(world, controller, 4))
    X = 8.0
    if lost == 'plan':
        controller.memory, _ = planner.brake(controller.memory, 'test')
    elif lost == 'path':
        moved = situation.reference._replace(X=situation.reference.X + 0.5)
        assert controller.set_reference(moved) == ''
    else:
        X += LOST_M + 0.1
    record = controller.step(TickInputs(world.rolling(X=X, stamp_ns=4 * TICK_NS)))
    foot = reference_path.project(controller.scene.path, X, 0.0, None, 10.0)
    assert record.x0.theta == pytest.approx(foot, abs=1e-9)


# arcs


def path_error(controller, plan):
    """Return how far the arc of each stage is from the path at the planned theta, m at most."""
    theta = plan.X[:, THETA]
    used = controller.memory.solved.problem.parameters.stages.path
    exact, _ = reference_path.arcs_at(controller.scene.path, theta)
    there, here = arc.pose_at(used, theta), arc.pose_at(exact, theta)
    return np.max(np.hypot(np.array(there.X) - here.X, np.array(there.Y) - here.Y))


@pytest.mark.parametrize('kind', ['frozen', 'refreshed'])
def test_refreshed_arcs_are_those_of_the_path_where_the_plan_is(world, changed, kind):
    """A plan that slows down far from its guess: frozen arcs miss the path by centimetres."""
    controller = changed(world.lane_change(v=12.0), surroundings__arcs=kind)
    record = controller.step(TickInputs(world.rolling(v=24.0, X=30.0)))
    guess = controller.memory.solved.problem.guess_map
    moved = np.max(np.abs(record.decision.plan.X[:, THETA] - guess.X[:, THETA]))
    error = path_error(controller, record.decision.plan)
    values = controller.report(record)[1].values
    if kind == 'refreshed':
        assert 1 <= values['solver.refreshes'] <= MOST_REFRESHES
        assert moved <= REFRESH_FROM_M
        assert error < 2e-3
        # a plan near its guess is not solved again
        world.set_inputs(controller, world.straight())
        assert [r.attempt.refreshes for r in records(world, controller, 3)] == [0] * 3
    else:
        assert moved > REFRESH_FROM_M
        assert 'solver.refreshes' not in values
        assert error > 2e-2


def test_a_refreshed_plan_that_may_not_be_driven_is_dropped(world, changed):
    state, situation = world.rolling(v=24.0, X=30.0), world.lane_change(v=12.0)
    frozen, controller = changed(situation), changed(situation, surroundings__arcs='refreshed')
    solves = world.ModifiedSolver(controller.parts.solvers.followed)
    solves.modify = lambda s: s._replace(status=FAILED) if len(solves.solutions) == 1 else s
    controller.parts.solvers.followed = solves
    record = controller.step(TickInputs(state))
    assert record.attempt.refreshes == 1
    assert record.attempt.solution.iterations == sum(s.iterations for s in solves.solutions)
    assert record.command == frozen.step(TickInputs(state)).command


@pytest.mark.parametrize(('limit_s', 'solves'), [(0.010, 1), (10.0, 2)])
def test_refreshing_ends_with_the_time_of_the_solver(world, limit_s, solves):
    """The solver takes 15 ms of a limit that is 10 ms from then on: no further solve begins.

    To build a problem takes 1 ms: the first one is not paid for by the solver.
    """
    changes = {'surroundings__arcs': 'refreshed', 'solver__time_limit_s': limit_s}
    clock = world.Clock()
    controller = Controller(*world.load(**changes), True, clock)
    world.set_inputs(controller, world.lane_change(v=12.0))
    model, build = controller.parts.model, controller.parts.model.build_problem

    def build_slowly(*arguments):
        clock.now += 0.001
        return build(*arguments)

    model.build_problem = build_slowly
    solver = world.ModifiedSolver(controller.parts.solvers.followed, clock=clock, takes_s=0.015)
    controller.parts.solvers.followed = solver
    controller.step(TickInputs(world.rolling(v=24.0, X=30.0)))
    count = len(solver.solutions)
    assert min(count, 2) == solves
    left = [limit_s - 0.015 * k - 0.001 * max(k - 1, 0) for k in range(count)]
    assert solver.limits_s == pytest.approx(left)
    # the next tick has the whole time again
    controller.step(TickInputs(world.rolling(v=24.0, X=31.0, stamp_ns=TICK_NS)))
    assert solver.limits_s[count] == pytest.approx(limit_s)


# the brake split


def test_a_fixed_split_brakes_with_its_share_and_has_no_cost(world, changed):
    fixed = {'formulation__brake_split': 'fixed'}
    unnamed = PredictionModel(*world.load('mpcc', **fixed))
    limits = unnamed.params.limits
    assert limits.brake_front_share_min == limits.brake_front_share_max == FRONT_SHARE
    fixed |= {'formulation__brake_front_share': 0.6}
    controller = changed(world.straight(v=12.0), 'frenet', **fixed)
    commands = [r.command for r in records(world, controller, 12, speed=25.0)]
    braking = [c for c in commands if c.Fxf + c.Fxr < -100.0]
    assert len(braking) > 8
    shares = [c.Fxf / (c.Fxf + c.Fxr) for c in braking]
    assert shares == pytest.approx([0.6] * len(braking), abs=1e-3)
    for model in (unnamed, controller.parts.model):
        assert 'lambda_b' not in {term.name for term in model.formulation.ocp.terms}


# the modes of the solver


def test_a_plan_of_one_step_keeps_its_own_limits_and_satisfies_the_model_exactly(world, changed):
    controller = changed(solver__mode='one_step')
    params, parts, kinds, iterations = controller.params, controller.parts, set(), []
    parts.solvers.followed = solver = world.ModifiedSolver(parts.solvers.followed)
    for record in records(world, controller, 40):
        why, plan = controller.report(record)[1], record.decision.plan
        solution = solver.solutions[-1]
        kinds.add((solution.status, why.values['reason']))
        iterations.append(solution.iterations)
        if solution.status == ONE_STEP:
            assert solution.primal_residual <= params.solver.one_step_residual
        after = parts.model.step(plan.X[0], plan.U[0], parts.model.car)
        assert plan.X[1] == pytest.approx(after, abs=1e-6)
        message = encode.why(why._replace(stamp_ns=why.stamp_ns + 1))  # the first stamp is 0
        assert not conformance.check('/controller/why', message)
    assert kinds == {(SOLVED, 'converged'), (ONE_STEP, 'one_step')}
    assert np.median(iterations) <= 2


def test_preparation_changes_the_initial_guess_and_not_the_problem_of_a_tick(
    world, changed, monkeypatch
):
    prepared = changed(solver__mode='one_step', solver__prepare=True)
    prepared.prepare()
    assert prepared.memory.prepared is None  # without a plan
    world.tick(prepared, world.rolling(X=45.0))
    kept = prepared.memory.plans.plan
    prepared.prepare()
    assert prepared.memory.plans.plan is kept
    expected = prepared.memory.prepared
    assert expected.X[0] == pytest.approx(kept.X[1], abs=1e-12)
    solves = world.ModifiedSolver(prepared.parts.solvers.followed)
    monkeypatch.setattr(prepared.parts.solvers, 'followed', solves)
    *_, why = world.tick(prepared, world.rolling(X=46.0, stamp_ns=TICK_NS))
    assert np.array_equal(prepared.memory.solved.problem.guess_map.U[:-1], kept.U[1:])
    assert np.array_equal(solves.guesses[0].U, expected.U)
    assert why.values['time.ahead_ms'] > 0
    solves.modify = lambda s: s._replace(status=FAILED)
    world.tick(prepared, world.rolling(X=47.0, stamp_ns=2 * TICK_NS))
    prepared.prepare()
    assert prepared.memory.prepared is None  # after a failure
