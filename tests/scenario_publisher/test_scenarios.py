"""The scenarios that come with the package are what their comments say."""

import re

import numpy as np
import pytest

from msgs_yaml import contract, share
from scenario_publisher import advice, road_geometry, scenario, schema
from scenario_publisher.actors import MAX_OBSTACLES
from scenario_publisher.plausibility import CAR_RADIUS

ALL = scenario.available()
DLC = scenario.load('double_lane_change')
PREVIEW_S = 2.5  # horizon of the controller


def at_x(ref, x):
    return np.interp(x, ref.X, ref.Y)


def gap(scn, o):
    """Return the gap [m] between the car's circle on the coarse path and an obstacle."""
    ref = scn.reference
    x, y = (np.interp(np.linspace(0, 1, 20001), np.linspace(0, 1, len(c)), c) for c in ref[1:3])
    return np.hypot(x - o.X, y - o.Y).min() - o.r_obs - CAR_RADIUS


SLIPPERY = ('split_mu', 'split_mu_obstacle', 'low_mu_obstacle')


@pytest.mark.parametrize('name', ALL)
def test_a_shipped_scenario_can_be_driven_to_its_end_and_gets_no_advice(name):
    scn = scenario.load(name)
    ref = scn.reference
    assert scn.name == name
    # the controller still sees path when it crosses the finish
    length = np.cumsum(np.hypot(np.diff(ref.X), np.diff(ref.Y)))
    finish = float(re.search(r'stop: \{progress_m: ([\d.]+)', scn.text).group(1))
    assert length[-1] - finish >= PREVIEW_S * scn.start.speed
    for edge in (scn.edges.left, scn.edges.right):  # the whole car stays on the road
        distance = np.hypot(*(np.column_stack(ref[1:3])[:, None] - edge[None]).T)
        assert distance.min() > CAR_RADIUS
    assert scn.stop.time >= ref.t[-1] + 2.0
    assert advice.flatten(advice.judge(scn, PREVIEW_S)) == []
    assert name in SLIPPERY or scn.patches == ((), ())
    # more would be a matter of taste; that the car survives is the least
    asked = {expectation.metric: expectation for expectation in scn.expect}
    assert not asked or asked['survived'].value is True


def test_at_least_24_scenarios_say_what_a_run_is_to_come_to():
    folder = share.path('scenario_publisher', 'scenarios')
    assert sum('\nexpect:' in (folder / f'{name}.yaml').read_text() for name in ALL) >= 24


def test_double_lane_change_has_the_lengths_of_iso_3888_1():
    x = np.array([0, 45, 60, 75, 100, 112.5, 125, 240])
    assert at_x(DLC.reference, x) == pytest.approx([0, 0, 1.75, 3.5, 3.5, 1.75, 0, 0], abs=2e-3)
    assert DLC.reference.X[-1] == pytest.approx(240.0, abs=1e-9)


def test_coarse_path_passes_both_obstacles_dangerously_close_on_opposite_sides():
    first, second = DLC.obstacles.items
    assert 0.0 < gap(DLC, first) < 0.1
    assert 0.0 < gap(DLC, second) < 0.5
    assert at_x(DLC.reference, first.X) > first.Y
    assert at_x(DLC.reference, second.X) < second.Y


def test_circle_has_the_papers_radius_and_displaced_obstacle():
    scn = scenario.load('circle_20m')
    ref, (obstacle,) = scn.reference, scn.obstacles.items
    centre_distance = np.hypot(ref.X, ref.Y - 20.0)
    assert centre_distance == pytest.approx(np.full(len(ref.X), 20.0), abs=1e-9)
    displaced = 20.0 - np.hypot(obstacle.X, obstacle.Y - 20.0)
    assert displaced == pytest.approx(obstacle.r_obs, abs=1e-4)
    assert ref.psi[-1] > 2 * np.pi  # more than a lap


def test_moving_obstacles_meet_the_car_where_the_comments_say():
    scn = scenario.load('moving_obstacle')
    (slow,) = scenario.obstacles_at(scn, 4.99, 1).items
    assert pytest.approx(100.0, abs=0.2) == slow.X
    _, walker = scenario.obstacles_at(scn, 8.5, 1).items
    car = np.interp(8.5, scn.reference.t, scn.reference.X)
    assert car == pytest.approx(170.0, abs=0.5)
    assert 3.5 - walker.Y - walker.r_obs - CAR_RADIUS == pytest.approx(0.5)


def test_what_a_scenario_may_hold_fits_into_the_messages():
    topics = contract.load().topics
    assert topics['/scenario/reference'].sizes['poses'].high == road_geometry.MAX_SAMPLES
    assert (
        topics['/scenario/road_edges'].sizes['markers[*].points'].high == road_geometry.MAX_SAMPLES
    )
    assert topics['/scenario/obstacles'].sizes['markers'].high >= 2 * MAX_OBSTACLES


def test_ranges_of_the_schema_lie_inside_those_of_the_messages():
    fields = contract.load().topics['/scenario/obstacles'].fields
    rules = {
        'markers[obstacle].pose.position.x': (schema.Coordinate, 1.0),
        'markers[obstacle].scale.x': (schema.Radius, 2.0),
        'markers[velocity].points[*].x': (schema.Velocity, np.sqrt(2.0)),
    }
    for path, (hint, scale) in rules.items():
        (rule,) = hint.__metadata__
        assert fields[path].low <= scale * rule.low <= scale * rule.high <= fields[path].high
