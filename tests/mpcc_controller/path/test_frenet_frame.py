"""Coordinates along the path, against plane geometry."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.path import frenet_frame, reference_path, road_edges
from mpcc_controller.path.distance import Disc
from mpcc_controller.path.frenet_frame import FrenetPoint
from msgs_yaml.types import Reference, RoadEdges

quick = settings(max_examples=40)
RADIUS, V = 20.0, 9.0
WINDOW = 2.0  # m


def circle(radius=RADIUS, turn=1.0, length=160.0, spacing=0.5):
    """Return a path on a circle through the origin, eastwards."""
    s = np.arange(0.0, length, spacing)
    psi = turn * s / radius
    X, Y = radius * np.sin(s / radius), turn * radius * (1 - np.cos(s / radius))
    return reference_path.build(Reference(0, X, Y, psi, s / V))


def on_circle(s, e, radius=RADIUS, turn=1.0):
    """Return the point of the map at path coordinates of that circle."""
    reach = radius - turn * e
    return reach * np.sin(s / radius), turn * (radius - reach * np.cos(s / radius))


@quick
@given(st.floats(1.0, 150.0), st.floats(-9.0, 9.0), st.sampled_from([1.0, -1.0]))
def test_beside_a_circle_the_coordinates_agree_with_trigonometry(s, e, turn):
    X, Y = (np.array([value]) for value in on_circle(s, e, turn=turn))
    point = frenet_frame.to_frenet(circle(turn=turn), X, Y, s)
    assert point.s[0] == pytest.approx(s, abs=1e-9)
    assert point.e[0] == pytest.approx(e, abs=1e-9)


@quick
@given(st.floats(20.0, 60.0), st.floats(-3.0, 3.0), st.floats(-2.0, 2.0))
def test_a_single_arc_gives_the_coordinates_of_a_point_metres_ahead_of_it(s, e, ahead):
    piece, _ = reference_path.arcs_at(circle(), np.array([s - ahead]))
    point = frenet_frame.to_frenet_on_arc(piece, *on_circle(s, e))
    assert point.s[0] == pytest.approx(s, abs=1e-6)
    assert point.e[0] == pytest.approx(e, abs=1e-9)


def test_on_a_straight_arc_the_coordinates_are_distance_ahead_and_to_the_left():
    X = np.arange(0.0, 50.0)
    straight = reference_path.build(Reference(0, X, 0 * X, 0 * X, X / V))
    piece, _ = reference_path.arcs_at(straight, np.array([10.0]))
    assert frenet_frame.to_frenet_on_arc(piece, 13.0, -2.0) == (
        pytest.approx([13.0]),
        pytest.approx([-2.0]),
    )


def test_of_two_laps_the_lap_near_the_car_counts():
    X, Y = (np.array([value]) for value in on_circle(10.0, 1.0))
    lap = 2 * np.pi * RADIUS
    s = [frenet_frame.to_frenet(circle(), X, Y, near).s[0] for near in (5.0, 130.0)]
    assert s == pytest.approx([10.0, 10.0 + lap], abs=1e-6)


@quick
@given(st.floats(-20.0, 200.0), st.floats(-8.0, 8.0))
def test_conversion_to_the_map_and_back_is_the_identity_also_beyond_both_ends(s, e):
    path = circle()
    there = frenet_frame.to_cartesian(path, FrenetPoint(np.array([s]), np.array([e])))
    back = frenet_frame.refine(path, there.X, there.Y, np.array([s]) + 0.7)
    assert (back.s[0], back.e[0]) == pytest.approx((s, e), abs=1e-8)


@quick
@given(st.floats(-4.0, 4.0), st.floats(-0.6, 0.6), st.floats(8.0, 30.0), st.floats(-4.0, 4.0))
def test_the_rates_are_the_derivatives_of_the_coordinates_of_a_moving_car(e, dpsi, vx, vy):
    path, s, r, h = circle(), 50.0, 0.3, 1e-4
    psi = s / RADIUS + dpsi
    speed = np.array([vx * np.cos(psi) - vy * np.sin(psi), vx * np.sin(psi) + vy * np.cos(psi)])
    here = np.array(on_circle(s, e))
    ends = [here + way * h * speed for way in (-1, 1)]
    before, after = (
        frenet_frame.refine(path, *(np.array([value]) for value in end), np.array([s]))
        for end in ends
    )
    derivatives = frenet_frame.rates(e, dpsi, 1 / RADIUS, vx, vy, r)
    along = (after.s[0] - before.s[0]) / (2 * h)
    assert derivatives.s == pytest.approx(along, rel=1e-6)
    assert derivatives.e == pytest.approx((after.e[0] - before.e[0]) / (2 * h), abs=1e-5)
    assert derivatives.dpsi == pytest.approx(r - along / RADIUS, abs=1e-6)


def test_edges_of_a_road_along_the_path_are_at_constant_offsets():
    angle = np.arange(-0.5, 9.0, 0.002)
    left, right = (
        np.column_stack(on_circle(RADIUS * angle, e)) for e in (3.0, -4.0)
    )  # inside and outside the bend
    pieces, _ = reference_path.arcs_at(circle(), np.linspace(5.0, 100.0, 20))
    frenet_edges = frenet_frame.edges_to_frenet(
        road_edges.build(RoadEdges(0, left, right)), pieces, WINDOW
    )
    assert frenet_edges.left.e == pytest.approx(np.full(20, 3.0), abs=1e-3)
    assert frenet_edges.right.e == pytest.approx(np.full(20, -4.0), abs=1e-3)
    assert np.abs(frenet_edges.left.slope).max() < 5e-3


def test_the_offset_of_a_converging_edge_is_measured_on_the_normal_of_the_path():
    """The path runs at 20 deg through a road along x: the edge is not met where it is nearest."""
    psi, s = np.radians(20.0), np.arange(0.0, 20.0)
    path = reference_path.build(
        Reference(0, s * np.cos(psi), s * np.sin(psi), np.full(20, psi), s / V)
    )
    edges = RoadEdges(0, *(np.array([[-50.0, y], [90.0, y]]) for y in (9.0, -3.0)))
    pieces, _ = reference_path.arcs_at(path, np.array([5.0, 10.0]))
    frenet_edges = frenet_frame.edges_to_frenet(road_edges.build(edges), pieces, WINDOW)
    heights = np.array([5.0, 10.0]) * np.sin(psi)
    assert frenet_edges.left.e == pytest.approx((9.0 - heights) / np.cos(psi), abs=1e-9)
    assert frenet_edges.right.e == pytest.approx((-3.0 - heights) / np.cos(psi), abs=1e-9)
    assert frenet_edges.left.slope == pytest.approx(np.full(2, -np.tan(psi)), abs=1e-9)
    # hence the edge is a straight line in path coordinates
    assert frenet_frame.edge_offset(frenet_edges.left, 10.0)[0] == pytest.approx(
        frenet_edges.left.e[1]
    )


def test_a_moving_obstacle_moves_along_the_path_and_a_resting_one_stays():
    t = 0.05 * np.arange(51)
    X, Y = on_circle(30.0 + 8.0 * t, 1.5)
    moving = frenet_frame.disc_to_frenet(circle(), Disc(X, Y, 1.0), 30.0)
    assert moving.s == pytest.approx(30.0 + 8.0 * t, abs=1e-6)
    assert moving.e == pytest.approx(np.full(51, 1.5), abs=1e-9)
    resting = frenet_frame.disc_to_frenet(circle(), Disc(0 * t + X[0], 0 * t + Y[0], 1.0), 30.0)
    assert resting.s == pytest.approx([30.0], abs=1e-9)
