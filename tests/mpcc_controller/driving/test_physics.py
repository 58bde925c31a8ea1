"""Physical properties of the commands of every controller, whichever problem it solves."""

import numpy as np
import pytest

from msgs_yaml.types import Obstacle, Obstacles
from stage_solver.solution import SOLVED


@pytest.fixture(params=['shared_controller', 'baseline_controller'])
def controller(request, world):
    return world.set_inputs(request.getfixturevalue(request.param), world.straight())


def test_a_straight_road_needs_no_steering(controller, world):
    command, prediction, why = world.tick(controller, world.rolling())
    assert why.values['rung'] == SOLVED
    assert abs(command.delta) < 1e-6
    assert np.max(np.abs(prediction.Y)) < 1e-4
    assert command.stamp_ns == prediction.stamp_ns == why.stamp_ns
    assert prediction.X[-1] == pytest.approx(50.0, rel=0.02)


def mirrored(situation):
    flip = np.array([1, -1])
    reference, edges, obstacles = situation
    return situation._replace(
        reference=reference._replace(Y=-reference.Y, psi=-reference.psi),
        edges=edges._replace(left=edges.right * flip, right=edges.left * flip),
        obstacles=Obstacles(0, tuple(o._replace(Y=-o.Y) for o in obstacles.items)),
    )


def test_a_mirrored_road_mirrors_the_steering(controller, world):
    situation = world.lane_change()
    state = world.rolling(X=25.0, psi=0.02, vy=0.1, r=0.05)
    world.set_inputs(controller, situation)
    here, plan, _ = world.tick(controller, state)
    world.set_inputs(controller, mirrored(situation))
    there, other, _ = world.tick(
        controller, state._replace(psi=-state.psi, vy=-state.vy, r=-state.r)
    )
    assert np.max(np.abs(plan.Y)) > 1
    assert pytest.approx(-plan.Y, abs=1e-4) == other.Y
    assert there.delta == pytest.approx(-here.delta, abs=1e-5)
    assert there.Fxf + there.Fxr == pytest.approx(here.Fxf + here.Fxr, abs=1.0)


@pytest.mark.parametrize('side', [1, -1])
def test_an_obstacle_beside_the_path_pushes_the_plan_to_the_free_side(controller, world, side):
    blocked = world.straight(obstacles=[Obstacle(1, 30.0, -0.5 * side, 1.0, 0.0, 0.0)])
    world.set_inputs(controller, blocked)
    _, prediction, why = world.tick(controller, world.rolling())
    beside = np.argmin(np.abs(prediction.X - 30.0))
    assert side * prediction.Y[beside] > 1.4
    assert why.values['v2o.1.least'] > 0
    assert why.values['q_v2o.1'] > 0
    assert why.values['cost.v2o'] > 0
