"""Obstacles that move along the road are expected to follow it; others go straight on."""

from dataclasses import replace

import numpy as np
import pytest

from mpcc_controller.path import reference_path, road_edges
from mpcc_controller.problem.obstacle_motion import position
from mpcc_controller.problem.road_following import along_road
from msgs_yaml.types import Obstacle, Obstacles, Reference, RoadEdges

T = np.linspace(0.0, 2.5, 26)


@pytest.fixture
def surroundings(params):
    return replace(params.surroundings, follow_road_rad=0.35)


def bend(radius, side):
    """Return path and road of a straight of 30 m, then a bend to the left (1) or right (-1)."""
    s = np.arange(0.0, 150.0, 1.0)
    angle = np.maximum(s - 30.0, 0.0) / radius
    X = np.minimum(s, 30.0) + radius * np.sin(angle)
    Y, psi = side * radius * (1 - np.cos(angle)), side * angle
    path = reference_path.build(Reference(0, X, Y, psi, s / 10.0))
    left, right = (
        np.column_stack([X - offset * np.sin(psi), Y + offset * np.cos(psi)])
        for offset in (5.25, -1.75)
    )
    return path, road_edges.build(RoadEdges(0, left, right))


def place(radius, side, s, offset):
    """Return X, Y and heading of a point of the bend."""
    angle = np.maximum(s - 30.0, 0.0) / radius
    X = np.minimum(s, 30.0) + radius * np.sin(angle)
    Y, psi = side * radius * (1 - np.cos(angle)), side * angle
    return X - offset * np.sin(psi), Y + offset * np.cos(psi), psi


def expected(o, road, surroundings):
    (item,) = along_road(Obstacles(1, (o,)), *road, surroundings).items
    return item


@pytest.mark.parametrize('radius', [40.0, 120.0])
@pytest.mark.parametrize('side', [1, -1])
@pytest.mark.parametrize(('way', 'offset', 'station'), [(-1, 3.5, 80.0), (1, 0.0, 20.0)])
def test_a_car_in_its_lane_stays_in_it(surroundings, radius, side, way, offset, station):
    """One that comes out of the bend onto the straight, and one that drives into the bend."""
    X, Y, psi = place(radius, side, station, offset)
    v, kappa = 10.0, side / radius
    car = Obstacle(1, X, Y, 1.0, way * v * np.cos(psi), way * v * np.sin(psi))
    X, Y = position(expected(car, bend(radius, side), surroundings), T)
    # along the path, in steps, since its rate changes where the bend begins
    s = [station]
    for _ in range(2500):
        s.append(s[-1] + way * v * 0.001 / (1 - kappa * offset * (s[-1] > 30.0)))
    wanted = place(radius, side, np.array(s[::100]), offset)
    assert np.max(np.hypot(X - wanted[0], Y - wanted[1])) < 0.15
    straight_on = np.hypot(car.X + car.vX * T - wanted[0], car.Y + car.vY * T - wanted[1])
    assert np.max(straight_on) > 2.0 * 0.15


@pytest.mark.parametrize(
    ('station', 'offset', 'turned', 'speed'),
    [(60.0, 3.5, 1.57, 1.5), (60.0, 9.0, 0.0, 10.0), (60.0, 0.0, 0.0, 0.0), (5.0, 0.0, 0.1, 5.0)],
    ids=['pedestrian', 'beside_the_road', 'standing', 'on_the_straight'],
)
def test_others_go_straight_on(surroundings, station, offset, turned, speed):
    X, Y, psi = place(80.0, 1, station, offset)
    course = psi + turned
    o = Obstacle(1, X, Y, 0.5, speed * np.cos(course), speed * np.sin(course))
    assert expected(o, bend(80.0, 1), surroundings) is o


def test_without_the_parameter_nobody_follows_the_road(params):
    X, Y, psi = place(40.0, 1, 60.0, 0.0)
    obstacles = Obstacles(1, (Obstacle(1, X, Y, 1.0, 10 * np.cos(psi), 10 * np.sin(psi)),))
    assert along_road(obstacles, *bend(40.0, 1), params.surroundings) is obstacles
