"""The receding horizon controller: its reports, its reaction to failures, its closed loop."""

import numpy as np
import pytest

from mpcc_controller.driving import planner
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.fallback import BRAKING
from mpcc_controller.driving.records import TickInputs
from mpcc_controller.problem.obstacle_motion import ExpectedObstacle
from msgs_yaml.types import Actuators, Obstacle, Obstacles
from stage_solver.solution import SOLVED, STOPPED_EARLY

TICK = 50_000_000


@pytest.fixture
def controller(shared_controller, world):
    return world.set_inputs(shared_controller, world.straight())


def test_at_the_desired_speed_the_force_goes_towards_the_drag(controller, world):
    run = world.drive(controller, 60)
    force = run.commands[-1].Fxf + run.commands[-1].Fxr
    drag = controller.car.drag * 20**2 + controller.car.rolling
    assert force == pytest.approx(drag, rel=0.1)
    assert run.commands[-1].Fxf == 0


def test_the_reported_cost_is_the_sum_of_its_terms_and_equals_that_of_the_solver(controller, world):
    world.set_inputs(controller, world.lane_change())
    _, _, why = world.tick(controller, world.rolling(X=20.0))
    costs = {name: value for name, value in why.values.items() if name.startswith('cost.')}
    total = costs.pop('cost.total')
    assert total == pytest.approx(sum(costs.values()), rel=1e-12)
    assert total == pytest.approx(why.values['solver.cost'], rel=1e-6)
    assert {name.removeprefix('cost.') for name in costs} == {
        name.removeprefix('weight.') for name in why.values if name.startswith('weight.')
    }


def test_heading_beyond_pi_is_taken_as_the_same_heading(controller, world):
    def westwards(reference):
        return reference._replace(X=-reference.X, psi=reference.psi * 0 + np.pi)

    situation = world.straight()
    swapped = situation.edges._replace(
        left=situation.edges.right * [-1, 1], right=situation.edges.left * [-1, 1]
    )
    world.set_inputs(
        controller, situation._replace(reference=westwards(situation.reference), edges=swapped)
    )
    command, prediction, _ = world.tick(controller, world.rolling(psi=-np.pi + 0.01))
    assert prediction.psi[0] == pytest.approx(np.pi + 0.01)
    assert -0.03 < command.delta < 0


def test_a_path_without_stamps_is_driven_at_the_speed_of_the_parameter(world):
    situation = world.straight(v=20.0)
    still = situation._replace(
        reference=situation.reference._replace(t=0.0 * situation.reference.t)
    )
    fault = Controller(*world.load()).set_reference(still.reference)
    assert 'surroundings.path_speed_mps' in fault
    timed = world.set_inputs(Controller(*world.load()), situation)
    given = world.set_inputs(Controller(*world.load(surroundings__path_speed_mps=20.0)), still)
    forces = [sum(world.tick(each, world.rolling())[0][3:]) for each in (timed, given)]
    assert forces[0] == pytest.approx(forces[1], abs=1.0)


def test_equal_inputs_give_equal_commands(controller, world):
    runs = []
    for _ in range(2):
        world.set_inputs(controller, world.lane_change())
        runs.append(world.drive(controller, 15).commands)
    assert runs[0] == runs[1]


def test_plan_of_a_lane_change_stays_inside_the_friction_circle(controller, world):
    world.set_inputs(controller, world.lane_change())
    _, _, why = world.tick(controller, world.rolling(X=20.0))
    assert 0.3 < why.values['friction.front_max'] < 1.02
    assert why.values['friction.rear_max'] < 1.02


# failures


def test_below_the_least_speed_the_car_brakes_to_a_stop_with_hysteresis(controller, world):
    decisions = []
    for k, v in enumerate((7.2, 6.9, 7.5, 7.9, 8.1)):
        *_, why = world.tick(controller, world.rolling(v=v, X=0.4 * k, stamp_ns=k * TICK))
        decisions.append((why.values['rung'], why.values['reason']))
    assert decisions[0][0] == SOLVED
    assert decisions[1:4] == [(BRAKING, 'too_slow')] * 3
    assert decisions[4][0] == SOLVED


def test_just_above_the_least_speed_hard_braking_is_still_a_solvable_problem(controller, world):
    controller.reset(Actuators(0, 0.0, 0.0, -7000.0, -5000.0, (0.0,) * 4))
    *_, why = world.tick(controller, world.rolling(v=7.1))
    assert why.values['rung'] == SOLVED
    assert why.values['cost.slow'] > 1.0
    assert why.values['slack.max'] < 0.01  # on the road


def test_outside_the_road_the_problem_stays_solvable(controller, world):
    world.set_inputs(controller, world.straight(left=3.0, right=-3.0))
    *_, why = world.tick(controller, world.rolling(Y=2.5))
    assert why.values['rung'] == SOLVED
    assert why.values['v2e.left'] < 0
    assert why.values['slack.max'] > 0.1


def test_a_restart_takes_its_setpoints_from_the_actuators(controller, world):
    controller.reset(Actuators(0, 0.05, 0.0, -1200.0, -800.0, (0.0,) * 4))
    _, _, why = world.tick(controller, world.rolling())
    assert why.values['set_point.delta'] == pytest.approx(0.05)
    assert why.values['set_point.Fx'] == pytest.approx(-2000.0)
    controller.reset(Actuators(0, 0.6, 0.0, 3000.0, -1000.0, (0.0,) * 4))
    assert controller.last_command.delta == pytest.approx(controller.params.limits.steer_rad)
    assert (controller.last_command.Fxf, controller.last_command.Fxr) == (0, 0)


def test_an_invalid_path_or_edge_is_rejected_and_the_old_one_kept(controller, world):
    situation = world.straight()
    before = controller.scene
    t = situation.reference.t.copy()
    t[3] = t[2]
    stuck = situation.reference._replace(t=t)
    assert 'stamp does not increase' in controller.set_reference(stuck)
    assert 'left edge' in controller.set_edges(situation.edges._replace(left=np.zeros((2, 2))))
    assert controller.scene == before


def test_the_same_path_again_keeps_theta(controller, world):
    world.tick(controller, world.rolling(X=30.0))
    assert controller.set_reference(world.straight().reference) == ''
    assert controller.memory.progress.theta == pytest.approx(30.0)
    controller.set_reference(world.straight(v=15.0).reference)
    assert controller.memory.progress.theta is None


def test_an_obstacle_that_appears_is_avoided_from_the_next_step_on(controller, world):
    world.tick(controller, world.rolling())
    controller.set_obstacles(Obstacles(0, (Obstacle(7, 28.0, -0.4, 1.0, 0.0, 0.0),)))
    *_, why = world.tick(controller, world.rolling(X=1.0, stamp_ns=TICK))
    assert why.values['rung'] == SOLVED
    assert why.values['v2o.7.least'] > 0


# closed loop


def test_a_lane_change_past_an_obstacle_ends_on_the_path_without_contact(controller, world):
    situation = world.lane_change()
    run = world.drive(world.set_inputs(controller, situation), 110)
    obstacle = situation.obstacles.items[0]
    x = run.states
    gap = np.hypot(x.X - obstacle.X, x.Y - obstacle.Y) - obstacle.r_obs - 1.1
    assert np.min(gap) > 0.2
    assert x.X[-1] > 100
    assert abs(x.Y[-1] - 3.5) < 0.2
    assert {why.values['rung'] for why in run.whys} <= {SOLVED, STOPPED_EARLY}
    assert not controller.memory.rejections


def test_without_collision_avoidance_the_same_lane_change_touches_the_obstacle(world):
    situation = world.lane_change()
    run = world.drive(world.set_inputs(Controller(*world.load('mpcc_no_ca')), situation), 80)
    obstacle = situation.obstacles.items[0]
    gap = np.hypot(run.states.X - obstacle.X, run.states.Y - obstacle.Y) - obstacle.r_obs - 1.1
    assert np.min(gap) < 0


@pytest.mark.parametrize('raises', [None, 'plan'])
def test_what_is_measured_is_remembered_while_ticks_raise(world, monkeypatch, raises):
    def fail(*_):
        raise RuntimeError('in the planner')

    controller = world.set_inputs(Controller(*world.load('mpcc_road')), world.straight())
    controller.reset(Actuators(0, *5 * [0.0]), resumed=True)
    if raises:
        monkeypatch.setattr(planner, raises, fail)
    records = []
    for k in range(8):
        x = world.rolling(X=k)._replace(stamp_ns=(k + 1) * TICK)
        actuators = Actuators(x.stamp_ns, *5 * [0.0])
        records.append(controller.step(TickInputs(x, actuators=actuators)))
    memory, stamp_ns = controller.memory, 8 * TICK
    assert bool(controller.errors.counts) == bool(raises)
    assert memory.known.stamp_ns == memory.sightings.true_state.stamp_ns == stamp_ns
    # neither a steering that agrees nor the start after a pause is forgotten
    steering, _ = memory.actuators.persistences
    assert steering.agreed_ns == stamp_ns
    assert [record.resumed for record in records] == [True] + 7 * [False]


def test_what_is_observed_of_obstacles_does_not_depend_on_messages_between_ticks(world):
    """A node receives obstacles before its restart and at any time; a replay has those of ticks."""

    def slowing(t):
        """Return a car ahead that brakes with 6 m/s^2; between ticks its speed has an error."""
        noise = 2.0 * np.sin(2 * np.pi * t / 0.05)
        car = Obstacle(1, 40.0 + 14.0 * t - 3.0 * t**2, 0.0, 1.0, 14.0 - 6.0 * t + noise, 0.0)
        return Obstacles(round(t * 1e9), (car,))

    controllers = [Controller(*world.load(surroundings__braking_window_s=0.15)) for _ in range(2)]
    node, replay = (world.set_inputs(c, world.straight()) for c in controllers)
    for t in np.arange(-0.2, 0.0, 0.013):
        node.set_obstacles(slowing(t))
    node.reset(world.REST)
    for tick in range(1, 8):
        t = 0.05 * tick
        node.set_obstacles(slowing(t - 0.017))
        records = []
        for controller in (node, replay):
            controller.set_obstacles(slowing(t))
            records.append(controller.step(TickInputs(world.rolling(X=t, stamp_ns=round(t * 1e9)))))
        assert records[0].scene.obstacles == records[1].scene.obstacles
        assert records[0].command == records[1].command
    assert isinstance(records[0].scene.obstacles.items[0], ExpectedObstacle)
