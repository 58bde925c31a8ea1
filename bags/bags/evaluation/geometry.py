"""Plane geometry: polylines, circles and the outline of the car; metres, radians, numpy only.

Independent of the distances in the controller: a polyline is not smoothed, and the vehicle is
evaluated by its true outline, too, not only by its circles.
"""

from typing import NamedTuple

import numpy as np

TIE = 1e-9  # m, below which two distances count as equal
STRAIGHT = 1e-12  # m, beside a straight line: rounding, and on no road a bend
NEAR = 1e-6  # m, more than rounding and a few ties
LAP_TOLERANCE = 1.0  # m; laps of a road count as equally near: their vertices do not coincide
BLOCK = 256  # points that are projected at a time


class Projection(NamedTuple):
    """Points in coordinates along a polyline; every array has one entry per point."""

    distance: np.ndarray  # m, from the start of the polyline to the foot
    offset: np.ndarray  # m, from the foot to the point, left of the driving direction positive
    segment: np.ndarray  # index of that of the foot


class Outline(NamedTuple):
    """A rectangle in the vehicle frame, x forward from the centre of gravity."""

    front: float  # m, centre of gravity to the front bumper
    rear: float  # m, centre of gravity to the rear bumper, positive
    width: float  # m

    @property
    def corners(self):
        """The four corners (4, 2) [m], front left first, clockwise."""
        front, rear, half = self.front, -self.rear, self.width / 2
        return np.array([[front, half], [front, -half], [rear, -half], [rear, half]])


def arc_length(points):
    """Return the distance (n,) [m] of each vertex of `points` (n, 2) from the first one."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])


def distance_to_polyline(points, polyline):
    """Return the distance (m,) [m] of `points` (m, 2) to the nearest of the segments (n, 2).

    Positive left of the line and negative right of it, seen in the order of its vertices; beyond
    an end the side is the one of the end segment.
    """
    points, polyline = np.asarray(points, dtype=float), np.asarray(polyline, dtype=float)
    if not len(points):
        return np.empty(0)
    # without the vertices on the line from their neighbour to the next
    steps = np.diff(polyline, axis=0)
    (dx, dy), (next_dx, next_dy) = steps[:-1].T, steps[1:].T
    limit = STRAIGHT * np.hypot(dx + next_dx, dy + next_dy)
    is_straight = np.abs(dx * next_dy - dy * next_dx) <= limit
    is_bend = ~(is_straight & (dx * next_dx + dy * next_dy > 0.0))
    segments = _segments(polyline[np.concatenate([[True], is_bend, [True]])])
    distances = []
    for block in np.split(points, range(BLOCK, len(points), BLOCK)):
        _, offset, square = segments.rows(_near(block, segments)).see(block)
        best = np.sqrt(square.min(axis=0))
        # at a shared vertex the segment that sees the point more squarely decides about the side
        squarely = np.where(square <= (best + TIE) ** 2, np.abs(offset), -1.0)
        side = offset[np.argmax(squarely, axis=0), np.arange(len(block))]
        distances.append(np.where(side >= 0.0, best, -best))
    return np.concatenate(distances)


def offset_from_line(points, polyline):
    """Return `distance_to_polyline` of a line that continues straight beyond both of its ends.

    There the distance is that from the line of the end segment: a point before the first vertex,
    but beside the line, is as far from it as its lateral offset.
    """
    points, polyline = np.asarray(points, dtype=float), np.asarray(polyline, dtype=float)
    distance = distance_to_polyline(points, polyline)
    for end, inner in ((0, 1), (-1, -2)):
        outwards = polyline[end] - polyline[inner]
        relative = points - polyline[end]
        nearest = np.abs(np.hypot(*relative.T) - np.abs(distance)) <= TIE
        rows = np.flatnonzero(nearest & (relative @ outwards > 0.0))
        forwards = outwards if end else -outwards
        x, y = relative[rows].T
        distance[rows] = (forwards[0] * y - forwards[1] * x) / np.hypot(*forwards)
    return distance


class _Segments(NamedTuple):
    """Segments of a polyline, one row (n, 1) each: numpy is quickest along the other axis."""

    x: np.ndarray  # m, of the tail
    y: np.ndarray  # m
    tx: np.ndarray  # direction, a unit vector
    ty: np.ndarray
    length: np.ndarray  # m

    def rows(self, chosen):
        """Return the chosen segments."""
        return _Segments(*(column[chosen] for column in self))

    def see(self, points):
        """Return foot and offset [m] and squared distance [m^2] of points, (n, m) each.

        The foot counts from the tail; the offset is that from the infinite line, left positive.
        """
        x, y = points[:, 0] - self.x, points[:, 1] - self.y
        ahead, offset = x * self.tx + y * self.ty, y * self.tx - x * self.ty
        foot = np.clip(ahead, 0.0, self.length)
        return foot, offset, offset**2 + (ahead - foot) ** 2

    def gaps(self, point):
        """Return the distance (n,) [m] of one point to each segment."""
        return np.sqrt(self.see(point[None])[2][:, 0])


def _segments(polyline):
    """Return the _Segments of a polyline (n, 2)."""
    dx, dy = np.diff(polyline, axis=0).T
    length = np.hypot(dx, dy)
    columns = (*polyline[:-1].T, dx / length, dy / length, length)
    return _Segments(*(column[:, None] for column in columns))


def _near(points, segments):
    """Return the indices, in their order, of all segments that may be nearest to one of `points`.

    Seen from the middle of points that lie within a radius of it, the segment nearest to one of
    them is at most twice that radius farther than the segment nearest to the middle.
    """
    middle = points.mean(axis=0)
    radius = np.hypot(*(points - middle).T).max()
    gap = segments.gaps(middle)
    # NaN, and only that, leaves all of them
    return np.flatnonzero(~(gap > gap.min() + 2.0 * radius + NEAR))


def offset_polyline(line, offset):
    """Return a polyline (n, 2) moved to its left by `offset` [m], vertex by vertex."""
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return line + offset * np.column_stack([-along[:, 1], along[:, 0]])


def project_drive(points, polyline, ahead):
    """Project a drive on a polyline without jumping to another lap or to a crossing branch.

    `points` (m, 2) are in driving order. Each is projected on the part of the polyline within
    `ahead` [m] of the foot of the previous point; the first one on all of it, where of several laps
    the first one within LAP_TOLERANCE of the nearest is taken. Return a Projection.
    """
    points = np.asarray(points, dtype=float)
    vertex = arc_length(polyline)
    moved = np.hypot(*np.diff(points, axis=0, prepend=points[:1]).T)
    segments = _segments(polyline)
    gaps = segments.gaps(points[0])
    near = gaps <= gaps.min() + LAP_TOLERANCE
    # the first of equally near laps: up to the first segment behind it that is not near
    first = int(np.argmax(near))
    last = first + int(np.argmin([*near[first:], False]))
    parts = [_feet(points[:1], segments, vertex, first, last)]
    done, size = 1, BLOCK
    while done < len(points):
        # many points at once, on all segments that any of them may need; kept while the result is
        # that of each point on its own part
        block = slice(done, done + size)
        before = parts[-1].distance[-1]
        reach = ahead + np.sum(moved[block][1:])
        wide = [int(end) for end in _within(vertex, before, reach)]
        feet = _feet(points[block], segments, vertex, *wide)
        first, last = _within(vertex, np.append(before, feet.distance[:-1]), ahead)
        sound = (first <= feet.segment) & (feet.segment < last)
        sound &= (wide[0] <= first) & (last <= wide[1])
        kept = len(sound) if sound.all() else int(np.argmin(sound))
        if kept:
            parts.append(Projection(*(column[:kept] for column in feet)))
        done, size = done + kept, min(BLOCK, max(1, 2 * kept))
    return Projection(*map(np.concatenate, zip(*parts)))


def _within(vertex, foot, reach):
    """Return the first segment, and the one behind the last, within `reach` [m] of a foot."""
    first = np.searchsorted(vertex, foot - reach) - 1
    last = np.searchsorted(vertex, foot + reach) + 1
    return np.maximum(first, 0), np.minimum(last, len(vertex) - 1)


def _feet(points, segments, vertex, first, last):
    """Return the Projection of points on the segments from `first` up to, not including, `last`."""
    chosen = first + _near(points, segments.rows(slice(first, last)))
    foot, offset, square = segments.rows(chosen).see(points)
    gap = np.sqrt(square.min(axis=0))
    # the earliest of equals: a closed road starts where it ends
    k, point = np.argmax(square <= (gap + TIE) ** 2, axis=0), np.arange(len(points))
    gap = np.copysign(np.sqrt(square[k, point]), offset[k, point])
    return Projection(vertex[chosen[k]] + foot[k, point], gap, chosen[k])


def gap_to_circle(x, y, yaw, outline, circle_x, circle_y, radius):
    """Return the clearance (m,) [m] between the outline of the vehicle and a round obstacle.

    All arguments but `outline` are broadcast. Negative values are the depth of the overlap: how
    far the circle would have to move to touch from outside.
    """
    dx, dy = circle_x - x, circle_y - y
    forward = np.cos(yaw) * dx + np.sin(yaw) * dy
    leftward = -np.sin(yaw) * dx + np.cos(yaw) * dy
    middle = (outline.front - outline.rear) / 2
    beyond_x = np.abs(forward - middle) - (outline.front + outline.rear) / 2
    beyond_y = np.abs(leftward) - outline.width / 2
    outside = np.hypot(np.maximum(beyond_x, 0.0), np.maximum(beyond_y, 0.0))
    inside = np.minimum(np.maximum(beyond_x, beyond_y), 0.0)
    return outside + inside - radius


def outline_points(outline, spacing):
    """Return points (n, 2) [m, vehicle frame] of an outline: its corners, and more on its sides.

    Two neighbours along a side are at most `spacing` [m] apart.
    """
    count = int(np.ceil((outline.front + outline.rear) / spacing)) + 1
    along = np.linspace(-outline.rear, outline.front, count)
    half = np.full(count, outline.width / 2)
    return np.concatenate([np.column_stack([along, half]), np.column_stack([along, -half])])


def transform_to_map(points, x, y, yaw):
    """Return points (n, 2) of the vehicle frame in the map: (n, 2) [m] of one pose, (m, n, 2) of m.

    A single point (2,) of a single pose gives (2,).
    """
    x, y, cos, sin = (np.asarray(value)[..., None] for value in (x, y, np.cos(yaw), np.sin(yaw)))
    forward, leftward = np.atleast_2d(points).T
    X, Y = x + cos * forward - sin * leftward, y + sin * forward + cos * leftward
    return np.stack([X, Y], axis=-1).reshape(*X.shape[: X.ndim - 1], *np.shape(points))
