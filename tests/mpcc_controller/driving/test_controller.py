"""The receding-horizon controllers tick by tick: what they solve, inputs, reports, warm-up."""

import numpy as np
import pytest

from mpcc_controller.driving import planner
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.records import TickInputs, unknown_state
from msgs_yaml import conformance, encode
from msgs_yaml.types import Actuators, Obstacles
from stage_solver.solution import FAILED, SOLVED

TICK = 50_000_000


@pytest.fixture
def controller(shared_controller, world):
    return world.set_inputs(shared_controller, world.straight())


@pytest.fixture
def baseline(baseline_controller, world):
    return world.set_inputs(baseline_controller, world.lane_change())


@pytest.fixture(params=['shared_controller', 'baseline_controller'])
def either(request, world):
    """Return the MPCC, then the baseline, on a straight road."""
    return world.set_inputs(request.getfixturevalue(request.param), world.straight())


# what can be solved


def test_heading_beyond_pi_is_taken_as_the_same_heading(controller, world):
    reference, edges, obstacles = world.straight()
    west = reference._replace(X=-reference.X, psi=reference.psi * 0 + np.pi)
    swapped = edges._replace(left=edges.right * [-1, 1], right=edges.left * [-1, 1])
    world.set_inputs(controller, type(world.straight())(west, swapped, obstacles))
    command, prediction, _ = world.tick(controller, world.rolling(psi=-np.pi + 0.01))
    assert prediction.psi[0] == pytest.approx(np.pi + 0.01)
    assert -0.03 < command.delta < 0
    # also where the path is sent again with a heading of another whole turn
    answers = []
    for slope in (-1e-9, 1e-9):
        world.set_inputs(controller, type(world.straight())(west, swapped, obstacles))
        world.tick(controller, world.rolling(psi=-np.pi + 0.01))
        controller.set_reference(west._replace(Y=slope * west.X))
        x = world.rolling(X=-1.0, Y=-0.01, psi=-np.pi + 0.005, stamp_ns=TICK)
        answers.append(world.tick(controller, x))
    (first, _, why), (other, turned, again) = answers
    assert turned.psi == pytest.approx(-np.pi, abs=0.02)
    assert other == pytest.approx(first, abs=1e-5)
    assert again.values['solver.iterations'] <= why.values['solver.iterations'] + 1


def test_hard_braking_above_the_least_speed_and_a_car_off_the_road_are_solvable(controller, world):
    controller.reset(Actuators(0, 0.0, 0.0, -7000.0, -5000.0, (0.0,) * 4))
    values = world.tick(controller, world.rolling(v=7.1))[2].values
    assert values['rung'] == SOLVED
    assert values['cost.slow'] > 1.0
    assert values['slack.max'] < 0.01  # on the road
    world.set_inputs(controller, world.straight(left=3.0, right=-3.0))
    values = world.tick(controller, world.rolling(Y=2.5))[2].values
    assert values['rung'] == SOLVED
    assert values['v2e.left'] < 0
    assert values['slack.max'] > 0.1


# inputs


def test_a_restart_cuts_the_set_points_of_the_actuators_to_the_limits(controller):
    controller.reset(Actuators(0, 0.6, 0.0, 3000.0, -1000.0, (0.0,) * 4))
    assert controller.memory.last.delta == pytest.approx(controller.params.limits.steer_rad)
    assert controller.memory.last[3:] == (0, 0)
    controller.reset(Actuators(0, 0.05, 0.0, -12e3, -8e3, (0.0,) * 4))
    brake_n = controller.params.limits.brake_n
    assert controller.memory.last[1:] == pytest.approx((0.05, 0.0, -0.6 * brake_n, -0.4 * brake_n))


@pytest.mark.parametrize(
    ('stamp_ns', 'resumed', 'believed'),
    [(5 * TICK, False, 0.3), (60 * TICK, False, 1.0), (5 * TICK, True, 1.0), (0, False, 1.0)],
    ids=['after an outage', 'after a long one', 'after a pause', 'in another drive'],
)
def test_what_is_known_of_the_road_stays_while_the_drive_goes_on(
    controller, world, stamp_ns, resumed, believed
):
    world.tick(controller, world.rolling(stamp_ns=3 * TICK))
    controller.memory = controller.memory._replace(believed=0.3)
    world.tick(controller, unknown_state(4 * TICK))
    controller.reset(Actuators(stamp_ns, *5 * [0.0]), resumed)
    assert controller.memory.believed == believed


def test_an_invalid_path_or_edge_is_rejected_and_the_old_one_kept(controller, world):
    situation, before = world.straight(), controller.scene
    t = situation.reference.t.copy()
    t[3] = t[2]
    assert 'stamp does not increase' in controller.set_reference(situation.reference._replace(t=t))
    assert 'left edge' in controller.set_edges(situation.edges._replace(left=np.zeros((2, 2))))
    assert controller.scene == before


def test_the_same_path_again_keeps_theta(controller, world):
    world.tick(controller, world.rolling(X=30.0))
    assert controller.set_reference(world.straight().reference) == ''
    assert controller.memory.progress.theta == pytest.approx(30.0)
    controller.set_reference(world.straight(v=15.0).reference)
    assert controller.memory.progress.theta is None


def test_a_car_begins_on_the_stretch_that_runs_with_it_where_the_way_back_is_closer(
    controller, world
):
    """There at Y = 0, around a half circle, back at Y = 3.5 m."""
    leg, angle = np.arange(0.0, 101.0), np.linspace(0.0, np.pi, 12)[1:-1]
    X = np.concatenate((leg, 100.0 + 1.75 * np.sin(angle), leg[::-1]))
    Y = np.concatenate((0 * leg, 1.75 * (1 - np.cos(angle)), 0 * leg + 3.5))
    psi = np.concatenate((0 * leg, angle, 0 * leg + np.pi))
    path = world.straight().reference._replace(X=X, Y=Y, psi=psi, t=0.1 * np.arange(len(X)))
    assert controller.set_reference(path) == ''
    for heading, expected in ((0.0, 60.0), (np.pi, 140.0 + 1.75 * np.pi)):
        controller.reset(world.REST)
        values = world.tick(controller, world.rolling(X=60.0, Y=1.8, psi=heading))[2].values
        assert values['theta'] == pytest.approx(expected, abs=0.1)


def test_plans_of_the_baseline_are_in_the_map_when_it_fails_and_on_a_new_path(
    baseline, world, monkeypatch
):
    """The same road with a path that begins 10 m later: s changes, the plan does not."""
    first = world.tick(baseline, world.rolling(X=30.0))[1]
    state, path = world.rolling(X=31.0, stamp_ns=TICK), world.lane_change().reference
    before = world.tick(baseline, state)[1]
    shorter = {name: getattr(path, name)[20:] for name in ('X', 'Y', 'psi')}
    world.set_inputs(baseline, world.lane_change())
    world.tick(baseline, world.rolling(X=30.0))
    assert baseline.set_reference(path._replace(**shorter, t=path.t[20:] - path.t[20])) == ''
    _, after, why = world.tick(baseline, state)
    assert why.values['rung'] == SOLVED
    assert why.values['theta'] == pytest.approx(21.0, abs=1e-6)
    assert why.values['solver.iterations'] < 12
    assert pytest.approx(before.X, abs=1e-3) == after.X
    assert pytest.approx(before.Y, abs=1e-3) == after.Y

    world.set_inputs(baseline, world.lane_change())
    world.tick(baseline, world.rolling(X=30.0))
    solver = baseline.parts.solvers.followed
    failing = world.ModifiedSolver(solver, lambda s: s._replace(status=FAILED))
    monkeypatch.setattr(baseline.parts.solvers, 'followed', failing)
    _, second, why = world.tick(baseline, state)
    assert why.values['rung'] == 'shifted'
    assert first.Y[2:] == pytest.approx(second.Y[1:-1], abs=1e-9)


def test_what_is_measured_is_remembered_while_ticks_raise(world, monkeypatch):
    def fail(*_):
        raise RuntimeError('in the planner')

    controller = world.set_inputs(Controller(*world.load('mpcc_road')), world.straight())
    controller.reset(Actuators(0, *5 * [0.0]), resumed=True)
    monkeypatch.setattr(planner, 'plan', fail)
    records = []
    for k in range(1, 9):
        x = world.rolling(X=k, stamp_ns=k * TICK)
        actuators = Actuators(x.stamp_ns, *5 * [0.0])
        records.append(controller.step(TickInputs(x, actuators=actuators)))
    memory = controller.memory
    assert controller.errors.counts.total() == 8
    assert memory.known.stamp_ns == 8 * TICK
    # neither a steering that agrees nor the start after a pause is forgotten
    steering, _ = memory.actuators.persistences
    assert steering.agreed_ns == 8 * TICK
    assert [record.resumed for record in records] == [True] + 7 * [False]


# the report of a tick

TERMS = {
    'mpcc': 'con lag vel d_delta d_Fx lambda_b v2o v2e slack slow',
    'frenet': 'e dpsi vel d_delta d_Fx lambda_b v2o v2e slack slow',
}
NAMES = (
    'rung reason gate gate.rejections theta vx v_ref set_point.delta set_point.Fx cost.total',
    'split.front split.ideal slack.max plan.age plan.failures',
    'solver.warm solver.status solver.message solver.iterations solver.cost',
    'solver.primal_residual solver.dual_residual',
    'time.prepare_ms time.solve_ms time.solve_cpu_ms time.lead_ms',
    'v2o.1 v2o.1.least v2o_frenet.1 v2o_difference.1 q_v2o.1 q_v2o.1.now',
    'v2e.left v2e.left.least v2e.right v2e.right.least',
    'q_v2e.left q_v2e.left.now q_v2e.right q_v2e.right.now',
    'friction.front friction.rear friction.front_max friction.rear_max',
)


def test_the_report_is_complete_agrees_with_the_solver_and_conforms_to_the_contract(either, world):
    name = either.params.formulation.name
    world.set_inputs(either, world.lane_change())
    x = world.rolling(X=40.0, Y=0.3, psi=0.05, stamp_ns=TICK)
    _, prediction, why = world.tick(either, x)
    values, terms = why.values, TERMS[name].split()
    costs = {term: values[f'cost.{term}'] for term in terms}
    errors = [f'error.{term}' for term in terms[:2]]
    expected = {f'{kind}.{term}' for kind in ('cost', 'weight') for term in terms}
    expected |= {*errors, *(f'{error}_max' for error in errors)}
    assert set(values) == set(' '.join(NAMES).split()) | expected
    assert not conformance.check('/controller/why', encode.why(why))
    assert values['cost.total'] == pytest.approx(sum(costs.values()), rel=1e-12)
    assert values['cost.total'] == pytest.approx(values['solver.cost'], rel=1e-6)
    assert values[errors[0]] == pytest.approx(0.3, abs=1e-6)
    if name == 'frenet':
        assert values['error.dpsi'] == pytest.approx(0.05, abs=1e-6)
    start = prediction.X[0], prediction.Y[0], prediction.psi[0]
    assert start == pytest.approx((40.0, 0.3, 0.05), abs=1e-9)


def test_obstacles_without_room_in_the_problem_are_named(controller, world):
    situation = world.lane_change()
    near, *_ = situation.obstacles.items
    # of the problem's four discs the near one takes one, the truck as many as come closest
    truck = near._replace(id=5, X=90.0, Y=-8.0, others=tuple((3.0 * k, 0.0) for k in range(1, 6)))
    far = truck._replace(id=2, X=150.0)
    controller.set_obstacles(situation.obstacles._replace(items=(near, far, truck)))
    *_, why = world.tick(controller, world.rolling(X=40.0, stamp_ns=TICK))
    assert why.values['obstacles.left_out'] == '2 wholly, 5 in part'
    solved = controller.memory.solved.problem.parameters.obstacles
    assert [disc.id for disc in solved] == [near.id, 5, 5, 5]
    assert not conformance.check('/controller/why', encode.why(why))
    controller.set_obstacles(situation.obstacles)
    *_, why = world.tick(controller, world.rolling(X=41.0, stamp_ns=2 * TICK))
    assert 'obstacles.left_out' not in why.values


@pytest.mark.parametrize(('X', 'Y'), [(69.0, 3.6), (72.0, 3.8)])
def test_distances_weights_and_their_frenet_counterparts_agree_with_the_geometry(
    controller, world, X, Y
):
    world.set_inputs(controller, world.lane_change())
    v = world.tick(controller, world.rolling(X=X, Y=Y))[2].values
    gap = np.hypot(X - 72.0, Y - 1.5) - 2.1
    assert v['v2o.1'] == pytest.approx(gap, abs=1e-5)
    assert v['v2o_difference.1'] == pytest.approx(v['v2o_frenet.1'] - v['v2o.1'], abs=1e-12)
    assert v['v2o_difference.1'] != 0
    assert v['v2o.1.least'] <= v['v2o.1']
    assert v['v2e.left'] == pytest.approx(6.0 - Y - 1.1, abs=1e-3)
    gauss = np.exp(-2 * gap**2 / controller.params.safety.obstacle_m**2)
    assert v['q_v2o.1.now'] == pytest.approx(v['weight.v2o'] * gauss, rel=1e-4, abs=1e-4)
    assert v['q_v2o.1.now'] <= v['q_v2o.1'] <= v['weight.v2o']


def mirrored(situation):
    flip = np.array([1, -1])
    reference, edges, obstacles = situation
    return situation._replace(
        reference=reference._replace(Y=-reference.Y, psi=-reference.psi),
        edges=edges._replace(left=edges.right * flip, right=edges.left * flip),
        obstacles=Obstacles(0, tuple(o._replace(Y=-o.Y) for o in obstacles.items)),
    )


def test_a_mirrored_road_mirrors_the_steering(either, world):
    situation = world.lane_change()
    state = world.rolling(X=25.0, psi=0.02, vy=0.1, r=0.05)
    world.set_inputs(either, situation)
    here, plan, _ = world.tick(either, state)
    world.set_inputs(either, mirrored(situation))
    there, other, _ = world.tick(either, state._replace(psi=-0.02, vy=-0.1, r=-0.05))
    assert np.max(np.abs(plan.Y)) > 1
    assert pytest.approx(-plan.Y, abs=1e-4) == other.Y
    assert there.delta == pytest.approx(-here.delta, abs=1e-5)
    assert there.Fxf + there.Fxr == pytest.approx(here.Fxf + here.Fxr, abs=1.0)


# the warm-up before the first command


def test_after_the_warm_up_the_commands_are_those_of_a_controller_that_did_not_warm_up(world):
    """Set-points, friction and obstacles are as before; all solvers have worked."""
    settings = world.load(candidates__most=4, fallback__recovery=True, **world.ESTIMATE)
    warm, cold = (
        world.set_inputs(Controller(*settings), world.lane_change(18.0)) for _ in range(2)
    )
    solvers = [world.ModifiedSolver(solver) for solver in warm.parts.solvers.parallel.solvers]
    warm.parts.solvers.parallel.solvers = solvers
    warm.parts.solvers.sliding = sliding = world.ModifiedSolver(warm.parts.solvers.sliding)
    before, x = warm.scene, world.rolling(v=18.0, X=20.0)
    steps = warm.warm_up(x, 12)
    assert next(steps)
    steps.close()  # cut short
    records = list(warm.warm_up(x, 12))
    assert [record.command.stamp_ns for record in records] == [TICK * k for k in range(1, 13)]
    assert sum(record.attempt.choice is not None for record in records) >= 3
    assert all(solver.solutions for solver in (*solvers, sliding))
    assert all(record.attempt.choice is None for record in records[-5:])
    assert (warm.memory.last, warm.memory.ramps) == (cold.memory.last, cold.memory.ramps)
    assert warm.scene is before
    assert warm.memory.computing_s  # what a tick takes is all that is remembered
    runs = [world.drive(controller, 12) for controller in (warm, cold)]
    assert runs[0].commands == runs[1].commands
    frictions = [[why.values['friction.estimate'] for why in run.whys] for run in runs]
    assert frictions[0] == frictions[1]


def test_times_of_receiving_and_publishing_are_reported_where_they_are_known(controller, world):
    *_, why = world.tick(controller, world.rolling(stamp_ns=TICK))
    assert not {'time.publish_ms', 'time.heard_ns', 'time.wait_ms'} & why.values.keys()
    known = {'received_ns': 77, 'wait_s': 0.002, 'publish_s': 0.004}
    *_, why = world.tick(controller, world.rolling(X=1.0, stamp_ns=2 * TICK), **known)
    times = [why.values[f'time.{name}'] for name in ('heard_ns', 'wait_ms', 'publish_ms')]
    assert times == pytest.approx([77, 2.0, 4.0])
    assert not conformance.check('/controller/why', encode.why(why))
