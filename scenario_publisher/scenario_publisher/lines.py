"""Lines in the plane: pieces of known curvature, splines, and their samples along the length.

Metres, radians, left positive, map frame. A piece (`Curve`) has its curvature and the heading
gained since its start in closed form; a `Line` is sampled from pieces or through points.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy  # a submodule loads when it is first used: an unknown name waits for none

from scenario_publisher.polyline import running_sum, steps

# rad, greatest heading of a lane change; steeper ones would drive across the road
MAX_LANE_CHANGE_HEADING = 1.2
# Gauss-Legendre quadrature over a lane change: exact to rounding up to that heading
_CHANGE_NODES, _CHANGE_WEIGHTS = np.polynomial.legendre.leggauss(40)
# and per sampling interval: exact to rounding while the heading turns < 1 rad in it
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
# a spline is measured on intervals this many times shorter than the spacing
_REFINEMENT = 4
ROUNDING = 1e-9
# m; laps whose distances differ by less are equally near
LAP_TOLERANCE_M = 1.0


class Curve(NamedTuple):
    """A piece of a line; both functions take the distance [m] (n,) from its start."""

    length: float  # m, along the curve
    kappa: Callable[[np.ndarray], np.ndarray]  # 1/m
    turn: Callable[[np.ndarray], np.ndarray]  # rad, heading minus heading at the start


class Line(NamedTuple):
    """Samples of a line in driving order, each array (n,)."""

    s: np.ndarray  # m, station: distance along the line
    X: np.ndarray  # m
    Y: np.ndarray  # m
    psi: np.ndarray  # rad, heading, continuous
    kappa: np.ndarray  # 1/m, curvature, left positive

    def __repr__(self) -> str:
        return f'Line({np.size(self.s)} samples over {np.max(self.s):g} m)'


class Frame(NamedTuple):
    """A pose on a line, or arrays of poses."""

    X: np.ndarray
    Y: np.ndarray
    psi: np.ndarray


def straight(length: float) -> Curve:
    """Return a straight of a length [m]."""
    return arc(length, 0.0)


def arc(length: float, kappa: float) -> Curve:
    """Return an arc of a length [m] and a curvature [1/m]."""
    return clothoid(length, kappa, kappa)


def clothoid(length: float, kappa_0: float, kappa_1: float) -> Curve:
    """Return a curve whose curvature changes linearly from kappa_0 to kappa_1 [1/m]."""
    rate = (kappa_1 - kappa_0) / length
    return Curve(
        length,
        lambda s: kappa_0 + rate * s,
        lambda s: kappa_0 * s + rate * s**2 / 2,
    )


def lane_change(advance: float, offset: float) -> Curve:
    """Return the curve that moves `offset` [m] to the left within `advance` [m] straight ahead.

    Heading and curvature are zero at both ends. The heading over the share q of the length is
    psi_max 16 q^2 (1 - q)^2, so the curvature is proportional to q (1 - q) (1 - 2 q): to first
    order the quintic of least jerk. psi_max and the length have no closed form, because the length
    depends on the heading; they are solved for. Raises ValueError when the offset is too large for
    the advance.
    """
    steepest = _offset_per_advance(MAX_LANE_CHANGE_HEADING)
    ratio = offset / advance
    if abs(ratio) > steepest:
        raise ValueError(
            f'moves {offset:g} m aside within {advance:g} m; '
            f'allowed at most {steepest * advance:.3g} m for this length'
        )
    psi_max = scipy.optimize.brentq(
        lambda psi: _offset_per_advance(psi) - ratio,
        -MAX_LANE_CHANGE_HEADING,
        MAX_LANE_CHANGE_HEADING,
        xtol=1e-15,
    )
    length = advance / _mean_over_length(np.cos, psi_max)
    return Curve(
        length,
        lambda s: psi_max / length * _heading_slope(s / length),
        lambda s: psi_max * _heading_shape(s / length),
    )


def _heading_shape(q):
    """Return the heading over the share q of the length, peak 1."""
    return 16 * q**2 * (1 - q) ** 2


def _heading_slope(q):
    """Return the derivative of `_heading_shape`."""
    return 32 * q * (1 - q) * (1 - 2 * q)


def _mean_over_length(function, psi_max):
    """Return the mean over the length of a function of the heading."""
    return _CHANGE_WEIGHTS @ function(psi_max * _heading_shape((_CHANGE_NODES + 1) / 2)) / 2


def _offset_per_advance(psi_max):
    return _mean_over_length(np.sin, psi_max) / _mean_over_length(np.cos, psi_max)


def line_from_curves(
    curves: Sequence[Curve], X: float, Y: float, psi: float, spacing: float
) -> Line:
    """Return curves joined end to end from a pose on, sampled at most `spacing` [m] apart.

    Every joint is a sample; its curvature is that of the curve that begins there.
    """
    pieces = []
    s = 0.0
    for curve in curves:
        piece = _sample_curve(curve, Line(s, X, Y, psi, 0.0), spacing)
        pieces.append(piece)
        s, X, Y, psi, _ = (column[-1] for column in piece)
    inner = [Line(*(column[:-1] for column in piece)) for piece in pieces[:-1]]
    return Line(*map(np.concatenate, zip(*inner, pieces[-1])))


def _sample_curve(curve, start, spacing):
    s = _sample_stations(curve.length, spacing)
    half = np.diff(s) / 2
    inside = s[:-1, None] + half[:, None] * (_NODES + 1)
    psi = start.psi + curve.turn(inside)
    dX, dY = half * (np.cos(psi) @ _WEIGHTS), half * (np.sin(psi) @ _WEIGHTS)
    return Line(
        start.s + s,
        start.X + running_sum(dX),
        start.Y + running_sum(dY),
        start.psi + curve.turn(s),
        curve.kappa(s),
    )


def line_through_points(points: np.ndarray, spacing: float) -> Line:
    """Return the cubic spline through points (n, 2), sampled at most `spacing` [m] apart.

    Heading and curvature are continuous. The points must not repeat.
    """
    chord = steps(points)
    spline = scipy.interpolate.CubicSpline(running_sum(chord), points)
    parts = running_sum(np.ceil(_REFINEMENT * chord / spacing))
    fine = np.interp(np.arange(parts[-1] + 1), parts, spline.x)
    half = np.diff(fine) / 2
    inside = fine[:-1, None] + half[:, None] * (_NODES + 1)
    speed = np.hypot(*np.moveaxis(spline(inside, 1), -1, 0))
    station = running_sum(half * (speed @ _WEIGHTS))
    s = _sample_stations(station[-1], spacing)
    u = scipy.interpolate.CubicSpline(station, fine)(s)
    (X, Y), (dX, dY), (ddX, ddY) = (spline(u, order).T for order in range(3))
    psi = np.unwrap(np.arctan2(dY, dX))
    return Line(s, X, Y, psi, (dX * ddY - dY * ddX) / np.hypot(dX, dY) ** 3)


def pose_at(line: Line, s: float) -> Frame:
    """Return the pose at stations [m] between 0 and the length of the line."""
    X = scipy.interpolate.CubicHermiteSpline(line.s, line.X, np.cos(line.psi))(s)
    Y = scipy.interpolate.CubicHermiteSpline(line.s, line.Y, np.sin(line.psi))(s)
    return Frame(X, Y, np.interp(s, line.s, line.psi))


def offset_point(frame: Frame, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return X and Y of the points `offset` [m] to the left of poses."""
    return frame.X - offset * np.sin(frame.psi), frame.Y + offset * np.cos(frame.psi)


def nearest_sample(line: Line, X: float, Y: float) -> int:
    """Return the index of the sample nearest to a point.

    Of several laps the first one within LAP_TOLERANCE_M of the nearest is taken.
    """
    dX, dY, to_X, to_Y = np.diff(line.X), np.diff(line.Y), X - line.X[:-1], Y - line.Y[:-1]
    share = np.clip((to_X * dX + to_Y * dY) / (dX**2 + dY**2), 0.0, 1.0)
    distance = np.hypot(to_X - share * dX, to_Y - share * dY)
    near = distance <= distance.min() + LAP_TOLERANCE_M
    first = int(np.argmax(near))
    length = int(np.argmin(near[first:]))  # 0: all that follow are near
    segment = first + int(np.argmin(distance[first : first + length if length else None]))
    return segment + int(share[segment] > 0.5)


def _sample_stations(length, spacing):
    # a length that is a multiple of the spacing must not get one more interval by rounding
    return np.linspace(0.0, length, 1 + max(1, int(np.ceil(length / spacing - ROUNDING))))
