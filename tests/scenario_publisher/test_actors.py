import numpy as np
import pytest

from scenario_publisher import actors, lines
from scenario_publisher.schema import MapObstacle, RoadObstacle

CIRCLE = lines.line_from_curves([lines.arc(60.0, 0.05)], 0.0, 0.0, 0.0, 1.0)
QUARTER = 10.0 * np.pi  # station at which a lap of 20 m radius points to +y, at (20, 20)


def test_obstacle_on_the_road_lies_beside_the_centre_line():
    placed = actors.place_actors((RoadObstacle(QUARTER, 2.0, 0.5),), CIRCLE)[0].obstacle
    assert pytest.approx((18.0, 20.0), abs=1e-4) == (placed.X, placed.Y)
    assert (placed.id, placed.r_obs) == (1, 0.5)


def test_velocity_along_and_across_follows_the_road_where_the_obstacle_is():
    given = RoadObstacle(QUARTER, 0.0, 0.5, along_mps=4.0, across_mps=1.0)
    placed = actors.place_actors((given,), CIRCLE)[0].obstacle
    assert (placed.vX, placed.vY) == pytest.approx((-1.0, 4.0), abs=1e-3)


def test_obstacle_in_the_map_stays_where_it_was_put():
    placed = actors.place_actors((MapObstacle(7.0, -3.0, 0.5),), CIRCLE)[0]
    assert actors.obstacle_at(placed, 12.0) == placed.obstacle
    assert (placed.obstacle.X, placed.obstacle.Y) == (7.0, -3.0)


def test_obstacle_is_there_from_its_appearance_until_it_disappears():
    placed = actors.place_actors((MapObstacle(0.0, 0.0, 1.0, 0.0, 0.0, 2.0, 5.0),), CIRCLE)[0]
    seen = [actors.is_present(placed, t) for t in (0.0, 1.999, 2.0, 4.999, 5.0)]
    assert seen == [False, False, True, True, False]


def test_motion_begins_at_the_given_place_when_it_appears():
    placed = actors.place_actors(
        (MapObstacle(1.0, 2.0, 1.0, 3.0, -4.0, appears_at_s=2.0),), CIRCLE
    )[0]
    at_first, later = actors.obstacle_at(placed, 2.0), actors.obstacle_at(placed, 2.5)
    assert (at_first.X, at_first.Y) == (1.0, 2.0)
    assert pytest.approx((2.5, 0.0)) == (later.X, later.Y)
