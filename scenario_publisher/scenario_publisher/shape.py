"""Lines and tables of the file turned into numbers, with what the schema alone cannot check.

`fail(key, what)` returns the error about a dotted key of the file.
"""

from collections.abc import Callable, Sequence

import numpy as np

from scenario_publisher import curves, line, polyline, schema, segments
from scenario_publisher.line import Line

Fail = Callable[[str, str], Exception]

MAX_SAMPLES = 5000  # of a published line, as topics.yaml allows
MAX_KAPPA = 0.2  # 1/m, the tightest circle a passenger car can turn
MAX_TURN = 0.5  # rad between neighbouring chords of a line that is to be smooth
MAX_CORNER = 1.05  # rad, of an edge, which may have corners
MAX_GAP = 10.0  # step to its neighbour step; beyond, a spline swings
SHORTEST_STEP = 0.001  # m, below it two points are the same
COORDINATE = 10000.0  # m


def make_line(given: schema.Line, key: str, spacing: float, fail: Fail) -> Line:
    """Return the sampled line of the block `key`."""
    if isinstance(given, schema.PointLine):
        points = make_points(given.points_m, key, MAX_TURN, fail)
        _refuse_gaps(points, key, fail)
        _refuse_many(polyline.steps(points).sum(), spacing, key, fail)
        made = line.through_points(points, spacing)
    else:
        if not given.segments:
            raise fail(f'{key}.segments', 'is empty; allowed at least 1 segment')
        pieces = [_curve(s, f'{key}.segments[{i}]', fail) for i, s in enumerate(given.segments)]
        _refuse_many(sum(piece.length for piece in pieces), spacing, key, fail)
        start = given.start
        made = line.from_curves(pieces, start.x_m, start.y_m, start.yaw_rad, spacing)
    _refuse_sharp(made, key, fail)
    _refuse_far(made.X, made.Y, key, fail)
    return made


def _curve(segment, key, fail):
    match segment:
        case segments.StraightSegment(straight=piece):
            return curves.straight(piece.length_m)
        case segments.ArcSegment(arc=piece):
            return curves.arc(piece.length_m, piece.curvature_1pm)
        case segments.ClothoidSegment(clothoid=piece):
            ends = piece.start_curvature_1pm, piece.end_curvature_1pm
            return curves.clothoid(piece.length_m, *ends)
        case segments.LaneChangeSegment(lane_change=piece):
            try:
                return curves.lane_change(piece.length_m, piece.offset_m)
            except ValueError as error:
                raise fail(f'{key}.lane_change.offset_m', str(error)) from None


def make_points(given: Sequence, key: str, max_turn: float, fail: Fail) -> np.ndarray:
    """Return points (n, 2) that neither repeat nor double back."""
    points = np.array(given, dtype=float).reshape(-1, 2)
    if len(points) < 2:
        raise fail(f'{key}.points_m', f'has {len(points)} points; allowed at least 2')
    for i in np.flatnonzero(polyline.steps(points) < SHORTEST_STEP):
        what = f'repeats the point before; allowed at least {SHORTEST_STEP:g} m between them'
        raise fail(f'{key}.points_m[{i + 1}]', what)
    turns = polyline.turns(points)
    for i in np.flatnonzero(turns > max_turn):
        what = f'the line turns by {np.degrees(turns[i]):.0f} deg here (a jump or a way back)'
        limit = f'allowed at most {np.degrees(max_turn):.0f} deg from point to point'
        raise fail(f'{key}.points_m[{i + 1}]', f'{what}; {limit}')
    return points


def make_table(stations: Sequence, values: Sequence, key: str, name: str, fail: Fail) -> np.ndarray:
    """Return the rows (n, 2) of a table over the station."""
    if len(stations) != len(values) or not stations:
        what = f'has {len(values)} values for {len(stations)} stations; allowed one for each'
        raise fail(f'{key}.{name}', what)
    for i in np.flatnonzero(np.diff(stations) <= 0.0):
        what = 'is not larger than the station before; allowed only increasing stations'
        raise fail(f'{key}.stations_m[{i + 1}]', what)
    return np.column_stack([stations, values])


def travel_times(path: Line, speed: np.ndarray) -> np.ndarray:
    """Return when [s] a vehicle with a desired speed, rows (station, speed), passes each sample.

    Between two samples it drives at the speed wanted in the middle.
    """
    middle = (path.s[:-1] + path.s[1:]) / 2
    steps = np.diff(path.s) / np.interp(middle, *speed.T)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _refuse_gaps(points, key, fail):
    steps = polyline.steps(points)
    ratio = np.maximum(steps[1:], steps[:-1]) / np.minimum(steps[1:], steps[:-1])
    for i in np.flatnonzero(ratio > MAX_GAP):
        what = f'a gap of {max(steps[i], steps[i + 1]):.3g} m beside a step of '
        what += f'{min(steps[i], steps[i + 1]):.3g} m; allowed at most {MAX_GAP:g} times as long'
        raise fail(f'{key}.points_m[{i + 1}]', what)


def refuse_samples(count: float, key: str, fail: Fail):
    """Refuse more samples than may be published."""
    if count > MAX_SAMPLES:
        what = f'needs {count:.0f} samples; allowed at most {MAX_SAMPLES}'
        raise fail(key, f'{what} (shorten it, or widen `sampling`)')


def _refuse_many(length, spacing, key, fail):
    refuse_samples(np.ceil(length / spacing) + 1, key, fail)


def _refuse_sharp(made, key, fail):
    i = int(np.argmax(np.abs(made.kappa)))
    if abs(made.kappa[i]) > MAX_KAPPA:
        what = f'has a curvature of {made.kappa[i]:.3g} 1/m at station {made.s[i]:.1f} m'
        raise fail(key, f'{what}; allowed -{MAX_KAPPA:g} to {MAX_KAPPA:g} 1/m')


def _refuse_far(X, Y, key, fail):
    farthest = max(np.abs(X).max(), np.abs(Y).max())
    if farthest > COORDINATE:
        what = f'reaches a coordinate of {farthest:.0f} m'
        raise fail(key, f'{what}; allowed -{COORDINATE:g} to {COORDINATE:g} m')
