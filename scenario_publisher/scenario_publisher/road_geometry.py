"""Lines, tables and the road of a scenario file as arrays, with checks beyond the schema.

Metres, map frame. Every function here raises KeyedError for geometry that cannot be driven or
published; keys are the dotted ones of the file.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scenario_publisher import lines, polyline, schema
from scenario_publisher.lines import Frame, Line
from scenario_publisher.schema import KeyedError

MAX_SAMPLES = 40_000  # of a published line, as topics.yaml allows
MAX_KAPPA = 0.2  # 1/m, the tightest circle a passenger car can turn
MAX_TURN = 0.5  # rad between neighbouring chords of a smooth line
MAX_CORNER = 1.05  # rad, of an edge, which may have corners
MAX_STEP_RATIO = 10.0  # of neighbouring steps; beyond, a spline oscillates
MIN_STEP = 0.001  # m, below it two points are the same
MAX_COORDINATE = 10000.0  # m
MIN_EDGE_OFFSET = 0.5  # m from the centre line to an edge
MAX_EDGE_OFFSET = 100.0  # m
MAX_EDGE_SLOPE = 1.0  # m of offset per metre of road
MIN_STRETCH = 0.05  # length of an edge over length of the centre line, inside of a bend
LEFT, RIGHT = 1, -1


class Road(NamedTuple):
    """The drivable road; edges (n, 2) in driving order."""

    centre: Line
    left: np.ndarray
    right: np.ndarray


class Outside(NamedTuple):
    """Distances of points from the road, (n,) each; negative is inside."""

    left: np.ndarray  # m beyond the left edge
    right: np.ndarray  # m beyond the right edge
    ends: np.ndarray  # m before the start or behind the end, never negative


def sample_line(block: schema.Line, key: str, spacing: float) -> Line:
    """Return the line of the block `key`, sampled at most `spacing` [m] apart."""
    if isinstance(block, schema.PointLine):
        points = check_points(block.points_m, key, MAX_TURN)
        steps = polyline.steps(points)
        longer, shorter = np.maximum(steps[1:], steps[:-1]), np.minimum(steps[1:], steps[:-1])
        for i in np.flatnonzero(longer / shorter > MAX_STEP_RATIO):
            what = f'a gap of {longer[i]:.3g} m beside a step of {shorter[i]:.3g} m'
            allowed = f'allowed at most {MAX_STEP_RATIO:g} times as long'
            raise KeyedError(f'{key}.points_m[{i + 1}]', f'{what}; {allowed}')
        _check_count(np.ceil(steps.sum() / spacing) + 1, key)
        line = lines.line_through_points(points, spacing)
    else:
        if not block.segments:
            raise KeyedError(f'{key}.segments', 'is empty; allowed at least 1 segment')
        curves = [_curve(s, f'{key}.segments[{i}]') for i, s in enumerate(block.segments)]
        length = sum(curve.length for curve in curves)
        _check_count(np.ceil(length / spacing) + 1, key)
        start = block.start
        line = lines.line_from_curves(curves, start.x_m, start.y_m, start.yaw_rad, spacing)
    i = int(np.argmax(np.abs(line.kappa)))
    if abs(line.kappa[i]) > MAX_KAPPA:
        what = f'has a curvature of {line.kappa[i]:.3g} 1/m at station {line.s[i]:.1f} m'
        raise KeyedError(key, f'{what}; allowed -{MAX_KAPPA:g} to {MAX_KAPPA:g} 1/m')
    extent = max(np.abs(line.X).max(), np.abs(line.Y).max())
    if extent > MAX_COORDINATE:
        what = f'reaches a coordinate of {extent:.0f} m'
        raise KeyedError(key, f'{what}; allowed -{MAX_COORDINATE:g} to {MAX_COORDINATE:g} m')
    return line


def _curve(segment, key):
    match segment:
        case schema.StraightSegment(piece):
            return lines.straight(piece.length_m)
        case schema.ArcSegment(piece):
            return lines.arc(piece.length_m, piece.curvature_1pm)
        case schema.ClothoidSegment(piece):
            ends = piece.start_curvature_1pm, piece.end_curvature_1pm
            return lines.clothoid(piece.length_m, *ends)
        case schema.LaneChangeSegment(piece):
            try:
                return lines.lane_change(piece.length_m, piece.offset_m)
            except ValueError as reason:
                raise KeyedError(f'{key}.lane_change.offset_m', str(reason)) from None


def check_points(rows: Sequence, key: str, max_turn: float) -> np.ndarray:
    """Return points (n, 2), n >= 2, that neither repeat nor turn by more than max_turn [rad]."""
    points = np.array(rows, dtype=float).reshape(-1, 2)
    if len(points) < 2:
        raise KeyedError(f'{key}.points_m', f'has {len(points)} points; allowed at least 2')
    for i in np.flatnonzero(polyline.steps(points) < MIN_STEP):
        what = f'repeats the point before; allowed at least {MIN_STEP:g} m between them'
        raise KeyedError(f'{key}.points_m[{i + 1}]', what)
    turns = polyline.turns(points)
    for i in np.flatnonzero(turns > max_turn):
        what = f'the line turns by {np.degrees(turns[i]):.0f} deg here (a jump or a way back)'
        limit = f'allowed at most {np.degrees(max_turn):.0f} deg from point to point'
        raise KeyedError(f'{key}.points_m[{i + 1}]', f'{what}; {limit}')
    return points


def build_table(stations: Sequence, values: Sequence, key: str, name: str) -> np.ndarray:
    """Return the rows (n, 2) of a table over increasing stations."""
    if len(stations) != len(values) or not stations:
        what = f'has {len(values)} values for {len(stations)} stations; allowed one for each'
        raise KeyedError(f'{key}.{name}', what)
    for i in np.flatnonzero(np.diff(stations) <= 0.0):
        what = 'is not larger than the station before; allowed only increasing stations'
        raise KeyedError(f'{key}.stations_m[{i + 1}]', what)
    return np.column_stack([stations, values])


def _check_count(count, key):
    if count > MAX_SAMPLES:
        what = f'needs {count:.0f} samples; allowed at most {MAX_SAMPLES}'
        raise KeyedError(key, f'{what} (shorten it, or widen `sampling`)')


def build_road(block: schema.Road, spacing: float) -> Road:
    """Return the road of the block `road`, points at most `spacing` [m] apart."""
    centre = sample_line(block.centre_line, 'road.centre_line', spacing)
    left = _edge(block.edges.left, LEFT, 'road.edges.left', centre, spacing)
    right = _edge(block.edges.right, RIGHT, 'road.edges.right', centre, spacing)
    return Road(centre, left, right)


def distance_outside(road: Road, X: np.ndarray, Y: np.ndarray) -> Outside:
    """Return how far points [m] are outside the road."""
    return Outside(
        polyline.left_of(road.left, X, Y),
        -polyline.left_of(road.right, X, Y),
        polyline.overrun(np.column_stack([road.centre.X, road.centre.Y]), X, Y),
    )


def _edge(block, side, key, centre, spacing):
    if isinstance(block, schema.PointEdge):
        return _polyline_edge(block, side, key, centre, spacing)
    if isinstance(block, schema.ConstantOffset):
        table = np.array([[0.0, block.offset_m]])
        keys = [f'{key}.offset_m']
    else:
        table = build_table(block.stations_m, block.offsets_m, key, 'offsets_m')
        keys = [f'{key}.offsets_m[{i}]' for i in range(len(table))]
    low, high = sorted((side * MIN_EDGE_OFFSET, side * MAX_EDGE_OFFSET))
    for i in np.flatnonzero((table[:, 1] < low) | (table[:, 1] > high)):
        what = f'is {table[i, 1]:g} (left is positive, edges must not cross)'
        raise KeyedError(keys[i], f'{what}; allowed {low:g} to {high:g} m')
    for i in np.flatnonzero(np.abs(np.diff(table[:, 1])) > MAX_EDGE_SLOPE * np.diff(table[:, 0])):
        s, offset = table[i + 1] - table[i]
        what = f'jumps by {offset:g} m within {s:g} m'
        raise KeyedError(keys[i + 1], f'{what}; allowed at most {MAX_EDGE_SLOPE:g} m per metre')
    offset = np.interp(centre.s, *table.T)
    stretch = 1.0 - centre.kappa * offset
    i = int(np.argmin(stretch))
    if stretch[i] < MIN_STRETCH:
        what = f'folds back in the bend of radius {1 / abs(centre.kappa[i]):.3g} m at station '
        what += f'{centre.s[i]:.1f} m; allowed less than {1 - MIN_STRETCH:g} of the radius'
        raise KeyedError(key, what)
    return np.column_stack(lines.offset_point(Frame(centre.X, centre.Y, centre.psi), offset))


def _polyline_edge(block, side, key, centre, spacing):
    points = check_points(block.points_m, key, MAX_CORNER)
    _check_count(np.sum(np.ceil(polyline.steps(points) / spacing)) + 1, key)
    edge = polyline.refine(points, spacing)
    middle = np.column_stack([centre.X, centre.Y])
    offset = side * polyline.left_of(middle, *edge.T)
    for i in np.flatnonzero(offset < MIN_EDGE_OFFSET):
        position = f'({edge[i, 0]:.1f}, {edge[i, 1]:.1f})'
        what = f'comes within {MIN_EDGE_OFFSET:g} m of the centre line or crosses it at {position}'
        allowed = f'allowed {MIN_EDGE_OFFSET:g} m or more on its own side'
        raise KeyedError(f'{key}.points_m', f'{what}; {allowed}')
    missing = polyline.overrun(edge, *middle.T).max()
    if missing > spacing:
        what = f'is {missing:.1f} m shorter than the road; allowed from its start to its end'
        raise KeyedError(f'{key}.points_m', what)
    return edge
