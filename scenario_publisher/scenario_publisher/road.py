"""The road: its centre line and the two edges that bound it. Metres, frame map."""

from typing import NamedTuple

import numpy as np

from scenario_publisher import line, polyline, schema, shape
from scenario_publisher.line import Frame, Line
from scenario_publisher.shape import Fail

NARROWEST = 0.5  # m from the centre line to an edge
WIDEST = 100.0  # m
STEEPEST = 1.0  # m of offset per metre of road
TIGHTEST = 0.05  # length of an edge to length of the centre line, inside of a bend
LEFT, RIGHT = 1, -1


class Road(NamedTuple):
    """Where one may drive; edges (n, 2) in driving order, no longer apart than sampled."""

    centre: Line
    left: np.ndarray
    right: np.ndarray


class Outside(NamedTuple):
    """How far points are off the road, each array one entry per point; negative is inside."""

    left: np.ndarray  # m beyond the left edge
    right: np.ndarray  # m beyond the right edge
    ends: np.ndarray  # m before the start or behind the end, never negative


def make(given: schema.Road, spacing: float, fail: Fail) -> Road:
    """Return the road of the file."""
    centre = shape.make_line(given.centre_line, 'road.centre_line', spacing, fail)
    left = _edge(given.edges.left, LEFT, 'road.edges.left', centre, spacing, fail)
    right = _edge(given.edges.right, RIGHT, 'road.edges.right', centre, spacing, fail)
    return Road(centre, left, right)


def outside(road: Road, X: np.ndarray, Y: np.ndarray) -> Outside:
    """Return how far points lie off the road."""
    return Outside(
        polyline.left_of(road.left, X, Y),
        -polyline.left_of(road.right, X, Y),
        polyline.overrun(np.column_stack([road.centre.X, road.centre.Y]), X, Y),
    )


def _edge(given, side, key, centre, spacing, fail):
    if isinstance(given, schema.PointEdge):
        return _own_edge(given, side, key, centre, spacing, fail)
    if isinstance(given, schema.ConstantOffset):
        table = np.array([[0.0, given.offset_m]])
        keys = [f'{key}.offset_m']
    else:
        table = shape.make_table(given.stations_m, given.offsets_m, key, 'offsets_m', fail)
        keys = [f'{key}.offsets_m[{i}]' for i in range(len(table))]
    _refuse_wrong_side(table, side, keys, fail)
    offset = np.interp(centre.s, *table.T)
    stretch = 1.0 - centre.kappa * offset
    i = int(np.argmin(stretch))
    if stretch[i] < TIGHTEST:
        what = f'folds back in the bend of radius {1 / abs(centre.kappa[i]):.3g} m at station '
        what += f'{centre.s[i]:.1f} m; allowed less than {1 - TIGHTEST:g} of the radius'
        raise fail(key, what)
    return np.column_stack(line.beside(Frame(centre.X, centre.Y, centre.psi), offset))


def _refuse_wrong_side(table, side, keys, fail):
    low, high = sorted((side * NARROWEST, side * WIDEST))
    for i in np.flatnonzero((table[:, 1] < low) | (table[:, 1] > high)):
        what = f'is out of range with {table[i, 1]:g} (left is positive, edges must not cross)'
        raise fail(keys[i], f'{what}; allowed {low:g} to {high:g} m')
    for i in np.flatnonzero(np.abs(np.diff(table[:, 1])) > STEEPEST * np.diff(table[:, 0])):
        what = f'jumps by {table[i + 1, 1] - table[i, 1]:g} m within '
        what += f'{table[i + 1, 0] - table[i, 0]:g} m; allowed at most {STEEPEST:g} m per metre'
        raise fail(keys[i + 1], what)


def _own_edge(given, side, key, centre, spacing, fail):
    points = shape.make_points(given.points_m, key, shape.MAX_CORNER, fail)
    shape.refuse_samples(np.sum(np.ceil(polyline.steps(points) / spacing)) + 1, key, fail)
    fine = polyline.refine(points, spacing)
    middle = np.column_stack([centre.X, centre.Y])
    reach = side * polyline.left_of(middle, *fine.T)
    for i in np.flatnonzero(reach < NARROWEST):
        where = f'({fine[i, 0]:.1f}, {fine[i, 1]:.1f})'
        what = f'comes within {NARROWEST:g} m of the centre line or crosses it at {where}'
        raise fail(f'{key}.points_m', f'{what}; allowed {NARROWEST:g} m or more on its own side')
    missing = polyline.overrun(fine, *middle.T).max()
    if missing > spacing:
        what = f'is {missing:.1f} m shorter than the road; allowed from its start to its end'
        raise fail(f'{key}.points_m', what)
    return fine
