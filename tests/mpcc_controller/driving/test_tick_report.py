"""The report of a tick, with the names of the contract."""

import numpy as np
import pytest

from mpcc_controller.driving.fallback import BRAKING
from msgs_yaml import conformance, encode
from stage_solver.solution import FAILED

TICK = 50_000_000


NAMES = (
    'rung reason gate gate.rejections theta vx v_ref set_point.delta set_point.Fx',
    'split.front split.ideal slack.max error.con error.con_max error.lag error.lag_max',
    'solver.warm solver.status solver.message solver.iterations solver.cost',
    'solver.primal_residual solver.dual_residual plan.age plan.failures',
    'time.prepare_ms time.solve_ms time.solve_cpu_ms time.lead_ms',
    'cost.total cost.con cost.lag cost.vel cost.d_delta cost.d_Fx cost.lambda_b cost.v2o cost.v2e',
    'cost.slack weight.con weight.lag weight.vel weight.d_delta weight.d_Fx weight.lambda_b',
    'weight.v2o weight.v2e weight.slack cost.slow weight.slow',
    'v2o.1 v2o.1.least v2o_frenet.1 v2o_difference.1 q_v2o.1 q_v2o.1.now',
    'v2e.left v2e.left.least v2e.right v2e.right.least',
    'q_v2e.left q_v2e.left.now q_v2e.right q_v2e.right.now',
    'friction.front friction.rear friction.front_max friction.rear_max',
)


def test_the_report_of_a_tick_is_complete_and_conforms_to_the_contract(controller, world):
    *_, why = world.tick(controller, world.rolling(X=40.0, stamp_ns=TICK))
    assert set(why.values) == set(' '.join(NAMES).split())
    assert not conformance.check('/controller/why', encode.why(why))


def test_obstacles_without_room_in_the_problem_are_counted(controller, world):
    situation = world.lane_change()
    near, *_ = situation.obstacles.items
    row = tuple(near._replace(id=k, X=90.0 + 5.0 * k, Y=-8.0) for k in range(2, 8))
    controller.set_obstacles(situation.obstacles._replace(items=(near, *row)))
    *_, why = world.tick(controller, world.rolling(X=40.0, stamp_ns=TICK))
    assert why.values['obstacles.left_out'] == 7 - controller.params.surroundings.max_obstacles
    assert not conformance.check('/controller/why', encode.why(why))
    controller.set_obstacles(situation.obstacles)
    *_, why = world.tick(controller, world.rolling(X=41.0, stamp_ns=2 * TICK))
    assert 'obstacles.left_out' not in why.values


def test_distances_weights_and_their_frenet_counterparts_agree_with_the_geometry(controller, world):
    x = world.rolling(X=69.0, Y=3.6, psi=0.0)
    *_, why = world.tick(controller, x)
    v = why.values
    gap = np.hypot(x.X - 72.0, x.Y - 1.5) - 2.1
    assert v['v2o.1'] == pytest.approx(gap, abs=1e-5)
    assert v['v2o_difference.1'] == pytest.approx(v['v2o_frenet.1'] - v['v2o.1'], abs=1e-12)
    assert v['v2o_difference.1'] != 0
    assert v['v2o.1.least'] <= v['v2o.1']
    assert v['q_v2o.1.now'] <= v['q_v2o.1'] <= v['weight.v2o']
    assert v['v2e.left'] == pytest.approx(6.0 - 3.6 - 1.1, abs=1e-3)


def test_the_present_weight_is_the_gaussian_of_the_present_distance(controller, world):
    x = world.rolling(X=72.0, Y=1.5 + 2.1 + 0.2)
    *_, why = world.tick(controller, x)
    D_sft = controller.params.safety.obstacle_m
    gauss = why.values['weight.v2o'] * np.exp(-2 * why.values['v2o.1'] ** 2 / D_sft**2)
    assert why.values['q_v2o.1.now'] == pytest.approx(gauss, rel=1e-9)


def test_the_time_of_publishing_is_reported_one_tick_later(realtime, world):
    *_, why = world.tick(realtime, world.rolling(stamp_ns=TICK))
    assert 'time.publish_ms' not in why.values
    *_, why = world.tick(realtime, world.rolling(X=1.0, stamp_ns=2 * TICK), publish_s=0.004)
    assert why.values['time.publish_ms'] == pytest.approx(4.0)


def test_the_report_of_a_failed_tick_conforms_to_the_contract(controller, world, modify_solver):
    modify_solver(lambda s: s._replace(status=FAILED))
    *_, why = world.tick(controller, world.rolling(X=40.0, stamp_ns=TICK))
    assert why.values['rung'] == BRAKING
    assert not conformance.check('/controller/why', encode.why(why))
