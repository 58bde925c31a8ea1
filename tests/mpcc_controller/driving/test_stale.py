"""What the controller does about inputs that grew too old, and before its first command."""

from itertools import pairwise

import pytest

from mpcc_controller.driving.fallback import BRAKING
from mpcc_controller.driving.tick import Arrival, unknown_state
from msgs_yaml import conformance, encode
from msgs_yaml.types import Actuators
from stage_solver.solution import SOLVED

TICK = 50_000_000


def told(why):
    return why.values['rung'], why.values['reason'], why.values.get('guide')


def test_without_a_state_it_brakes_straight_at_once_inside_the_limits(changing, world):
    first, *_ = world.tick(changing, world.rolling(X=40.0))
    limits = changing.params.limits
    commands = [first]
    for k in range(1, 6):
        command, prediction, why = world.tick(
            changing, unknown_state(k * TICK), fault='state_stale'
        )
        assert told(why) == (BRAKING, 'state_stale', 'none')
        assert why.values['gate'] == 'passed'
        assert not len(prediction.X)
        assert not conformance.check('/controller/why', encode.why(why))
        commands.append(command)
    forces = [c.Fxf + c.Fxr for c in commands]
    steps = [b - a for a, b in pairwise(forces)]
    assert steps[0] == pytest.approx(-limits.force_rate_nps * 0.05, rel=1e-6)
    assert min(steps) >= -limits.force_rate_nps * 0.05 * (1 + 1e-6)
    assert forces[-1] < -8000.0
    assert commands[-1].delta == 0.0


def test_after_blind_braking_it_starts_from_where_the_actuators_are(changing, world):
    world.tick(changing, world.rolling(X=40.0))
    world.tick(changing, unknown_state(TICK), fault='state_stale')
    changing.reset(Actuators(2 * TICK, -0.03, 0.0, -3000.0, -1000.0, (0.0,) * 4))
    command, _, why = world.tick(changing, world.rolling(X=42.0, stamp_ns=2 * TICK))
    assert told(why)[:2] == (SOLVED, 'converged')
    assert why.values['set_point.delta'] == pytest.approx(-0.03)
    assert why.values['set_point.Fx'] == pytest.approx(-4000.0)
    assert abs(command.delta + 0.03) <= changing.params.limits.steer_rate_radps * 0.05 * 1.001


@pytest.mark.parametrize('fault', ['obstacles_stale', 'reference_stale', 'edges_stale'])
def test_without_fresh_surroundings_it_brakes_along_the_last_plan(changing, world, fault):
    world.tick(changing, world.rolling(X=40.0))
    *_, why = world.tick(changing, world.rolling(X=41.0, stamp_ns=TICK), fault=fault)
    assert told(why) == (BRAKING, fault, 'plan')
    assert 'time.solve_ms' not in why.values
    *_, why = world.tick(changing, world.rolling(X=42.0, stamp_ns=2 * TICK))
    assert told(why)[:2] == (SOLVED, 'converged')
    assert not why.values['solver.warm']


def test_braking_is_not_what_the_next_solve_is_expected_to_take(late, world):
    world.tick(late, world.rolling(stamp_ns=TICK))
    expected = late.latency.estimate(0.0)
    for k in range(2, 30):
        world.tick(late, unknown_state(k * TICK), fault='state_stale')
    assert late.latency.estimate(0.0) == expected


def test_how_the_state_came_is_told_where_it_is_known(changing, world):
    arrival = Arrival(received_ns=77, wait_s=0.002)
    *_, why = world.tick(changing, world.rolling(stamp_ns=TICK), arrival=arrival)
    assert (why.values['time.heard_ns'], why.values['time.wait_ms']) == (77, pytest.approx(2.0))
    assert not conformance.check('/controller/why', encode.why(why))
    *_, why = world.tick(changing, world.rolling(stamp_ns=2 * TICK))
    assert 'time.heard_ns' not in why.values


def test_a_rehearsal_leaves_nothing_behind_but_the_computing_time(late, world):
    x = world.rolling(X=10.0, stamp_ns=TICK)
    stamps = [record.command.stamp_ns for record in late.warm_up(x, 5)]
    assert stamps == [(1 + k) * TICK for k in range(1, 6)]
    assert late.planner.fallback.plan is None
    assert late.planner.theta is None
    assert not late.gate.rejections
    assert late.latency.estimate(0.0) == pytest.approx(0.015 + 0.001)
