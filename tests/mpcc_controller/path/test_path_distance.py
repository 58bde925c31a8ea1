"""Distances in path coordinates: the paper's 20 m circle, in closed form."""

import numpy as np
import pytest

from mpcc_controller.path import distance, frenet_frame, reference_path
from mpcc_controller.path.distance import Circle, Disc
from mpcc_controller.path.frenet_frame import FrenetDisc, FrenetPoint
from msgs_yaml.types import Reference

RADIUS, R_VEH, R_OBS = 20.0, 1.1, 1.0


@pytest.fixture(scope='module')
def circle():
    """Return more than a lap to the left about (0, 20), in arcs that are exact to 1e-11 m."""
    phi = np.arange(0.0, 2.6 * np.pi, 0.01)
    X, Y = RADIUS * np.sin(phi), RADIUS * (1 - np.cos(phi))
    return reference_path.build(Reference(0, X, Y, phi, phi * RADIUS / 9.0))


def on(s, left):
    """Return the point at the arc length s, so many metres to the left of the circle."""
    inner = RADIUS - left
    return inner * np.sin(s / RADIUS), RADIUS - inner * np.cos(s / RADIUS)


def frenet_point(path, point, near):
    projected = frenet_frame.to_frenet(path, *(np.array([value]) for value in point), near)
    return FrenetPoint(projected.s[0], projected.e[0])


def frenet_v2o(path, vehicle, obstacle, near):
    car, other = (frenet_point(path, point, near) for point in (vehicle, obstacle))
    return frenet_frame.v2o(car, R_VEH, FrenetDisc(*other, R_OBS))


@pytest.mark.parametrize('ds', [2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0])
@pytest.mark.parametrize('n', [1.0, -1.0], ids=['inside', 'outside'])
def test_on_the_circle_both_distances_are_the_closed_forms(circle, ds, n):
    start = 8.0
    vehicle, obstacle = on(start, 0.0), on(start + ds, n)
    along = frenet_v2o(circle, vehicle, obstacle, start)
    assert along == pytest.approx(np.hypot(ds, n) - R_OBS - R_VEH, abs=1e-6)
    inner = RADIUS - n
    chord = np.sqrt(RADIUS**2 + inner**2 - 2 * RADIUS * inner * np.cos(ds / RADIUS))
    straight = distance.v2o(Circle(*vehicle, R_VEH), Disc(*obstacle, R_OBS))
    assert straight == pytest.approx(chord - R_OBS - R_VEH, abs=1e-6)
    if n > 0:
        assert along > straight


@pytest.mark.parametrize(
    ('n', 'ds', 'difference'),
    [(1, 10, 0.35), (1, 40, 7.19), (-1, 10, -0.14), (-1, 20, 0.35)],
)
def test_path_coordinates_overestimate_the_distance_inside_and_underestimate_it_nearby_outside(
    circle, n, ds, difference
):
    vehicle, obstacle = on(3.0, 0.0), on(3.0 + ds, float(n))
    straight = np.hypot(*np.subtract(vehicle, obstacle)) - R_OBS - R_VEH
    assert frenet_v2o(circle, vehicle, obstacle, 3.0) - straight == pytest.approx(
        difference, abs=5e-3
    )


def test_beside_a_straight_path_both_distances_are_equal(world):
    path = reference_path.build(world.straight().reference)
    for obstacle in ((30.0, 1.5), (-20.0, -2.0), (400.0, 3.0)):
        straight = np.hypot(obstacle[0] - 12.0, obstacle[1] - 0.4) - R_OBS - R_VEH
        assert frenet_v2o(path, (12.0, 0.4), obstacle, 12.0) == pytest.approx(straight, abs=1e-6)


def test_a_long_segment_is_found_although_its_ends_are_far():
    X, Y = np.array([0.0, 100.0, 110.0, 110.0, 50.0]), np.array([0.0, 0.0, 10.0, 30.0, 40.0])
    path = reference_path.build(
        Reference(0, X, Y, np.array([0.0, 0.1, 1.2, 1.9, 3.0]), np.array([0.0, 5.0, 6.0, 7.0, 9.0]))
    )
    assert frenet_point(path, (50.0, 1.0), 40.0).s == pytest.approx(50.0, abs=5.0)
