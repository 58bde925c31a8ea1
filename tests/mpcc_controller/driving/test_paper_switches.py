"""The switches between this MPCC and the printed one: theta, arcs of the path, brake split."""

from itertools import pairwise

import numpy as np
import pytest

from mpcc_controller import brake_split
from mpcc_controller.driving import planner
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.path_progress import LOST_M
from mpcc_controller.driving.records import TickInputs
from mpcc_controller.driving.tick_solvers import MOST_REFRESHES, REFRESH_FROM_M
from mpcc_controller.model.single_track import State
from mpcc_controller.path import arc, reference_path
from mpcc_controller.problem import cost_terms
from node_runtime.parameters import ParameterError
from stage_solver.solution import FAILED

TICK_NS = 50_000_000
THETA = State._fields.index('theta')


def changed(world, situation, name='mpcc', **changes):
    """Return a controller with other parameters on a road."""
    return world.set_inputs(Controller(*world.load(name, **changes)), situation)


def records(world, controller, ticks, speed=20.0):
    """Return the TickRecords of a closed loop with the prediction model as the car."""
    advance = world.make_car(controller.car)
    x = State(0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(ticks):
        state = world.rolling(stamp_ns=k * TICK_NS)._replace(**dict(zip(State._fields[:6], x[:6])))
        record = controller.step(TickInputs(state))
        yield record
        x = advance(x, record.command)


def path_errors(controller, plan):
    """Return how far the arc of each stage is from the path at the planned theta, (N + 1,) m."""
    theta = plan.X[:, THETA]
    used = controller.memory.solved.problem.parameters.stages.path
    exact, _ = reference_path.arcs_at(controller.scene.path, theta)
    there, here = arc.pose_at(used, theta), arc.pose_at(exact, theta)
    return np.hypot(np.array(there.X) - here.X, np.array(there.Y) - here.Y)


def test_an_integrated_theta_is_the_distance_travelled_and_a_projected_one_that_along_the_path(
    world,
):
    """The distance by quadrature of the measured speed, that along the path by its projection."""
    travelled = {}
    for kind in ('integrated', 'projected'):
        controller = changed(world, world.lane_change(), model__theta=kind)
        run = list(records(world, controller, 90))
        speed = np.array([np.hypot(r.state.vx, r.state.vy) for r in run])
        theta = np.array([r.x0.theta for r in run])
        distance = np.concatenate(([0], np.cumsum((speed[1:] + speed[:-1]) / 2 * 0.05)))
        travelled[kind] = theta - distance
        path = controller.scene.path
        foot = reference_path.project(path, run[-1].x0.X, run[-1].x0.Y, None, 10.0)
        lag = theta[-1] - foot
        assert (abs(lag) < 1e-9) == (kind == 'projected')
    # a car that cuts the bends travels less than the path is long
    assert np.max(np.abs(travelled['integrated'])) < 2e-3
    assert np.max(np.abs(travelled['projected'])) > 2e-2


def test_an_integrated_theta_is_that_of_the_last_plan_and_its_error_costs(world):
    controller = changed(world, world.lane_change(), model__theta='integrated')
    run = list(records(world, controller, 70))
    for before, record in pairwise(run):
        assert record.x0.theta == before.decision.plan.X[1, THETA]
    lags = [controller.report(record)[1].values['error.lag'] for record in run[-1:]]
    assert abs(lags[0]) > 1e-3


def test_a_late_state_has_the_theta_of_its_instant(world):
    controller = changed(world, world.straight(), model__theta='integrated')
    first = controller.step(TickInputs(world.rolling(X=25.0)))
    late = controller.step(TickInputs(world.rolling(X=27.0, stamp_ns=2 * TICK_NS)))
    assert late.x0.theta == first.decision.plan.X[2, THETA]


@pytest.mark.parametrize('lost', ['plan', 'path', 'far'])
def test_an_integrated_theta_starts_from_the_projection_again_when_it_is_lost(world, lost):
    situation = world.lane_change()
    controller = changed(world, situation, model__theta='integrated')
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


def test_refreshed_arcs_are_those_of_the_path_where_the_plan_is(world):
    """A plan that slows down far from its guess: frozen arcs miss the path by centimetres."""
    situation = world.lane_change(v=12.0)
    errors = {}
    for kind in ('frozen', 'refreshed'):
        controller = changed(world, situation, surroundings__arcs=kind)
        record = controller.step(TickInputs(world.rolling(v=24.0, X=30.0)))
        problem = controller.memory.solved.problem
        moved = np.abs(record.decision.plan.X[:, THETA] - problem.guess_map.X[:, THETA])
        errors[kind] = np.max(path_errors(controller, record.decision.plan))
        if kind == 'refreshed':
            why = controller.report(record)[1].values
            assert 1 <= why['solver.refreshes'] <= MOST_REFRESHES
            assert np.max(moved) <= REFRESH_FROM_M
        else:
            assert np.max(moved) > REFRESH_FROM_M
            assert 'solver.refreshes' not in controller.report(record)[1].values
    assert errors['refreshed'] < 2e-3
    assert errors['frozen'] > 2e-2


def test_a_plan_near_its_guess_is_not_solved_again(world):
    controller = changed(world, world.straight(), surroundings__arcs='refreshed')
    run = list(records(world, controller, 5))
    assert [r.attempt.refreshes for r in run] == [0] * 5


def test_a_refreshed_plan_that_may_not_be_driven_is_dropped(world):
    state, situation = world.rolling(v=24.0, X=30.0), world.lane_change(v=12.0)
    frozen = changed(world, situation)
    controller = changed(world, situation, surroundings__arcs='refreshed')
    solves = world.ModifiedSolver(controller.parts.solvers.first)
    solves.modify = lambda s: s._replace(status=FAILED) if len(solves.solutions) == 1 else s
    controller.parts.solvers.first = solves
    record = controller.step(TickInputs(state))
    assert record.attempt.refreshes == 1
    assert record.attempt.solution.iterations == sum(s.iterations for s in solves.solutions)
    assert record.command == frozen.step(TickInputs(state)).command


def test_refreshing_ends_with_the_time_of_the_solver(realtime, world):
    """The solver takes 15 ms of a limit that is 10 ms from then on: no further solve begins."""
    for limit_s, solves in ((0.010, 1), (10.0, 2)):
        changes = {
            'surroundings__arcs': 'refreshed',
            'solver__time_limit_s': limit_s,
        }
        realtime.parts.clock.now = 0.0
        controller = Controller(*world.load(**changes), True, realtime.parts.clock)
        world.set_inputs(controller, world.lane_change(v=12.0))
        solver = world.ModifiedSolver(
            controller.parts.solvers.first, clock=realtime.parts.clock, takes_s=0.015
        )
        solver.limits = []
        solver.set_time_limit = solver.limits.append
        controller.parts.solvers.first = solver
        controller.step(TickInputs(world.rolling(v=24.0, X=30.0)))
        assert min(len(solver.solutions), 2) == solves
        assert solver.limits[-1:] == ([limit_s] if solves > 1 else [])


@pytest.mark.parametrize('share', [None, 0.6])
@pytest.mark.parametrize('name', ['mpcc', 'frenet'])
def test_a_fixed_split_brakes_with_its_share_and_has_no_cost(world, name, share):
    changes = {
        'formulation__brake_split': 'fixed',
        'formulation__brake_front_share': share,
    }
    controller = changed(world, world.straight(v=12.0), name, **changes)
    commands = [r.command for r in records(world, controller, 20, speed=25.0)]
    braking = [c for c in commands if c.Fxf + c.Fxr < -100.0]
    assert len(braking) > 10
    expected = share or brake_split.FRONT_SHARE
    assert [c.Fxf / (c.Fxf + c.Fxr) for c in braking] == pytest.approx(
        [expected] * len(braking), abs=1e-5
    )
    assert 'lambda_b' not in {term.name for term in controller.parts.model.formulation.ocp.terms}


def test_switches_that_are_off_change_no_bit(world):
    """Given as the words for off, and left out: the same terms, the same commands."""
    off = {
        'model__theta': 'projected',
        'surroundings__arcs': 'frozen',
        'formulation__brake_split': 'free',
    }
    commands = []
    for changes in ({}, off):
        controller = changed(world, world.lane_change(), **changes)
        commands.append([record.command for record in records(world, controller, 20)])
        assert controller.parts.model.formulation.ocp.terms == cost_terms.PAPER
    assert commands[0] == commands[1]


@pytest.mark.parametrize(
    ('name', 'changes', 'field'),
    [
        ('frenet', {'model__theta': 'integrated'}, 'model.theta'),
        ('tracking', {'model__theta': 'integrated'}, 'model.theta'),
        ('mpcc', {'formulation__brake_front_share': 0.6}, 'formulation.brake_front_share'),
        (
            'mpcc',
            {'formulation__brake_split': 'free', 'formulation__brake_front_share': 0.6},
            'formulation.brake_front_share',
        ),
    ],
)
def test_a_switch_that_cannot_be_used_names_its_field(world, name, changes, field):
    with pytest.raises(ParameterError, match=f'{field}: .*allowed'):
        Controller(*world.load(name, **changes))
