"""What the problems are asked about."""

import pytest

from mpcc_controller.path import reference, road
from mpcc_controller.problem.stages import Scene


@pytest.fixture(scope='session')
def scene(world):
    situation = world.lane_change()
    return Scene(
        reference.build(situation.reference), road.build(situation.edges), situation.obstacles
    )
