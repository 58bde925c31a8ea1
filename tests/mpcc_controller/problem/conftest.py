"""The formulation and the scene that the tests of the problems share."""

import pytest

from mpcc_controller.path import reference_path, road_edges
from mpcc_controller.problem import formulation
from mpcc_controller.problem.stage_parameters import Scene


@pytest.fixture(scope='session')
def mpcc(params, car):
    """Return the paper's formulation."""
    return formulation.make(params, car)


@pytest.fixture(scope='session')
def scene(world):
    situation = world.lane_change()
    return Scene(
        reference_path.build(situation.reference),
        road_edges.build(situation.edges),
        situation.obstacles,
    )
