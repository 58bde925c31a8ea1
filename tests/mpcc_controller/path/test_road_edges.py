"""Road edges: the nearest point, the touching parabola, the middle of the road."""

import numpy as np
import pytest

from mpcc_controller.path import distance, road_edges
from mpcc_controller.path.arc import Arc
from mpcc_controller.path.distance import Circle
from mpcc_controller.path.road_edges import EdgeError
from msgs_yaml.types import RoadEdges

R = 40.0


def ring_road(turn=1, step=1.0):
    """Return a road of 7 m about a circle of radius R that starts along x at the origin."""
    s = np.arange(-30, 90, step) / R

    def line(n):
        radius = R - turn * n
        return np.column_stack((radius * np.sin(s), turn * (R - radius * np.cos(s))))

    return road_edges.build(RoadEdges(0, line(3.5), line(-3.5)))


@pytest.mark.parametrize('turn', [1, -1])
def test_distances_to_curved_edges_are_those_to_circles(turn):
    road = ring_road(turn)
    for angle, n in ((0.3, 0.0), (0.5, 1.5), (1.0, -2.0)):
        radius = R - turn * n
        X, Y = radius * np.sin(angle), turn * (R - radius * np.cos(angle))
        edges = road_edges.edges_near(road, np.array([X]), np.array([Y]), 2.0)
        to_left, to_right = distance.v2e(Circle(X, Y, 1.1), edges)
        # corners 1 m apart lie 1 / (8 R) = 3 mm outside their chord
        assert float(to_left[0]) == pytest.approx(3.5 - n - 1.1, abs=5e-3)
        assert float(to_right[0]) == pytest.approx(3.5 + n - 1.1, abs=5e-3)


@pytest.mark.parametrize('turn', [1, -1])
def test_an_edge_bends_with_the_road(turn):
    edges = road_edges.edges_near(ring_road(turn), np.array([10.0]), np.array([turn * 1.0]), 4.0)
    assert edges.left.kappa[0] == pytest.approx(turn / (R - turn * 3.5), rel=0.05)
    assert edges.right.kappa[0] == pytest.approx(turn / (R + turn * 3.5), rel=0.05)


def test_the_middle_of_the_road_is_between_the_edges_for_every_path():
    sides = [np.array([[-10.0, y], [100.0, y]]) for y in (6.0, -2.5)]
    road = road_edges.build(RoadEdges(0, *sides))
    on_path = Arc(np.array([20.0]), np.array([3.5]), np.zeros(1), np.zeros(1), np.array([20.0]))
    track = road_edges.track_beside(road, on_path, 2.0)
    assert (track.centre.X[0], track.centre.Y[0]) == pytest.approx((20.0, 1.75))
    assert track.half_width[0] == pytest.approx(4.25)


def test_in_a_funnel_the_centre_is_moved_beside_the_path():
    """Both edges close in by 45 deg: the closest points lie ahead of the point of the path."""
    sides = [
        np.array([[-20.0, y * 5.0], [0.0, y * 5.0], [3.0, y * 2.0], [40.0, y * 2.0]])
        for y in (1.0, -1.0)
    ]
    road = road_edges.build(RoadEdges(0, *sides))
    at = np.array([-0.5, 1.0, 2.0])
    on_path = Arc(at, np.zeros(3), np.zeros(3), np.zeros(3), at)
    closest = road_edges.track_beside(road, on_path, 0.2)
    assert np.all(closest.centre.X[1:] > at[1:] + 0.5)
    track = road_edges.track_beside(road, on_path, 0.2, aligned=True)
    np.testing.assert_allclose(track.centre.X, at, atol=1e-9)
    np.testing.assert_allclose(track.centre.Y, 0.0, atol=1e-9)
    np.testing.assert_array_equal(track.half_width, closest.half_width)


def test_past_its_ends_an_edge_continues_straight():
    sides = [np.array([[0.0, y], [10.0, y]]) for y in (3.0, -3.0)]
    road = road_edges.build(RoadEdges(0, *sides))
    edges = road_edges.edges_near(road, np.array([200.0, -200.0]), np.array([1.0, 1.0]), 2.0)
    assert pytest.approx([3.0, 3.0]) == edges.left.Y
    assert pytest.approx([200.0, -200.0]) == edges.left.X


def test_far_past_its_ends_an_edge_is_the_same_straight_line():
    direction, across = np.array([0.8, 0.6]), np.array([-0.6, 0.8])
    sides = [np.outer((0.0, 10.0), direction) + n * across for n in (3.0, -3.0)]
    road = road_edges.build(RoadEdges(0, *sides))
    for along in (-5000.0, 1500.0):
        X, Y = along * direction + 1.0 * across
        edges = road_edges.edges_near(road, np.array([X]), np.array([Y]), 2.0)
        assert (*edges.left.kappa, *edges.right.kappa) == pytest.approx((0.0, 0.0), abs=1e-9)
        to_left, to_right = distance.v2e(Circle(X, Y, 1.1), edges)
        assert float(to_left[0]) == pytest.approx(2.0 - 1.1, abs=1e-6)
        assert float(to_right[0]) == pytest.approx(4.0 - 1.1, abs=1e-6)


def test_an_edge_that_doubles_back_has_a_curvature_everywhere():
    there_and_back = np.array([[0.0, 3.0], [10.0, 3.0], [0.0, 3.0]])
    road = road_edges.build(RoadEdges(0, there_and_back, np.array([[0.0, -3.0], [10.0, -3.0]])))
    edges = road_edges.edges_near(road, np.linspace(-5.0, 20.0, 26), np.zeros(26), 2.0)
    assert np.all(np.isfinite(edges.left))


def test_repeated_points_of_an_edge_are_dropped():
    left = np.array([[0.0, 3.0], [0.0, 3.0], [10.0, 3.0], [10.0, 3.0]])
    road = road_edges.build(RoadEdges(0, left, left - [0.0, 6.0]))
    assert np.all(np.diff(road.left.s) > 0)


@pytest.mark.filterwarnings('error::RuntimeWarning')
def test_points_of_an_edge_whose_distance_underflows_are_merged():
    near = np.array([[0.0, 3.0], [5e-324, 3.0], [1e-170, 3.0], [10.0, 3.0]])
    road = road_edges.build(RoadEdges(0, near, np.array([[0.0, -3.0], [10.0, -3.0]])))
    edges = road_edges.edges_near(road, np.linspace(-5.0, 15.0, 21), np.zeros(21), 2.0)
    assert np.all(np.isfinite(edges.left))
    with pytest.raises(EdgeError, match='the left edge has fewer than two distinct points'):
        road_edges.build(RoadEdges(0, near[:3], near))


@pytest.mark.parametrize(
    'left', [np.array([[0.0, 3.0]]), np.array([[0.0, 3.0], [np.nan, 3.0]]), np.zeros((3, 2))]
)
def test_an_edge_that_is_no_line_is_rejected_and_its_side_named(left):
    right = np.array([[0.0, -3.0], [10.0, -3.0]])
    with pytest.raises(EdgeError, match='left edge'):
        road_edges.build(RoadEdges(0, left, right))
