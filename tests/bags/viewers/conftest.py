"""A straight piece of road with a car, an obstacle and a plan."""

import numpy as np
import pytest

from bags.viewers import marker_scene
from msgs_yaml.types import Obstacle, Prediction, Reference, RoadEdges, VehicleState

S = 1_000_000_000
PARAMS = marker_scene.ShapeParams(
    marker_scene.OutlineParams(front_m=2.27, rear_m=2.57, width_m=1.85),
    marker_scene.SafetyParams((1.2, -1.2), 1.1, 0.5, 0.4),
)
STATE = VehicleState(S, 10.0, 2.0, np.pi / 2, 20.0, 0.0, 0.0)
OBSTACLES = (Obstacle(7, 40.0, 1.0, 0.8, 0.0, 0.0),)
EDGES = RoadEdges(S, np.array([[0.0, 6.0], [99.0, 6.0]]), np.array([[0.0, -3.0], [99.0, -3.0]]))
STAGES = np.arange(51) * 0.05
PLAN = Prediction(S, 20.0 * STAGES - STAGES**2, 0.0 * STAGES, 0.0 * STAGES, STAGES)
PATH = Reference(S, np.array([0.0, 90.0]), np.zeros(2), np.zeros(2), np.array([0.0, 4.5]))


@pytest.fixture
def drawn():
    """Return the shapes of every marker topic."""
    use = {'front': 0.62, 'rear': 1.4}
    return {
        '/markers/vehicle': marker_scene.vehicle_shapes(STATE, use, PARAMS.outline),
        '/markers/safety': marker_scene.safety_shapes(STATE, OBSTACLES, EDGES, PARAMS.safety),
        '/markers/prediction': marker_scene.prediction_shapes(PLAN, PATH),
    }


@pytest.fixture
def find():
    """Return find(shapes, ns) -> those of one name, in the order of their ids."""
    return lambda found, ns: [item for item in found if item.ns == ns]
