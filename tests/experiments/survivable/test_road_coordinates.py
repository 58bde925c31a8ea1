"""Coordinates along the coarse path, against circles whose coordinates are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.survivable.road_coordinates import RoadCoordinates, reference_of
from msgs_yaml.types import Reference, RoadEdges

RADIUS, SPEED = 60.0, 15.0


def arc(radius, spacing=0.5):
    """Return points of a left bend of 90 deg that begins at the origin along x."""
    angle = np.arange(0.0, np.pi / 2, spacing / radius)
    return angle, radius * np.sin(angle), RADIUS - radius * np.cos(angle)


@pytest.fixture(scope='module')
def bend():
    angle, X, Y = arc(RADIUS)
    edges = [np.column_stack(arc(RADIUS - n, 1.0)[1:]) for n in (4.0, -3.0)]
    reference = Reference(0, X, Y, angle, RADIUS * angle / SPEED)
    return RoadCoordinates(reference, RoadEdges(0, *edges))


@settings(max_examples=50)
@given(st.floats(5.0, 85.0), st.floats(-8.0, 8.0))
def test_points_beside_a_circle_have_its_arc_length_and_their_distance(bend, s, n):
    angle = s / RADIUS
    X, Y = (RADIUS - n) * np.sin(angle), RADIUS - (RADIUS - n) * np.cos(angle)
    station, offset = bend.project(X, Y)
    assert float(station) == pytest.approx(s, abs=0.05)
    assert float(offset) == pytest.approx(n, abs=0.005)
    assert float(bend.beyond_edge(X, Y)) == pytest.approx(max(n - 4.0, -3.0 - n), abs=0.02)


def test_a_line_beside_a_circle_is_a_circle(bend):
    s = np.arange(5.0, 80.0, 0.5)
    path = bend.shifted(s, np.full(len(s), 3.0))
    assert path.kappa[5:-5] == pytest.approx(1 / (RADIUS - 3.0), rel=0.01)
    assert path.psi[5:-5] == pytest.approx(s[5:-5] / RADIUS, abs=0.01)


def test_a_path_has_the_desired_speed_that_it_is_given(bend):
    s = np.arange(5.0, 80.0, 0.5)
    path = bend.shifted(s, np.zeros(len(s)))
    reference = reference_of(path, np.full(len(s), 12.0), 7)
    chords = np.hypot(np.diff(path.X), np.diff(path.Y))
    assert chords / np.diff(reference.t) == pytest.approx(12.0)
    assert reference.stamp_ns == 7
