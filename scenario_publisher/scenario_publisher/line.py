"""Lines sampled along their length: from curves or through points. Metres, radians, frame map."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy  # a submodule loads when it is first used: an unknown name waits for none

from scenario_publisher.curves import Curve

# Gauss-Legendre per sampling interval: exact to rounding while the heading turns < 1 rad in it
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
# a spline is measured on intervals this many times shorter than the wanted spacing
FINER = 4
ROUNDING = 1e-9


class Line(NamedTuple):
    """Samples of a line in driving order, each array (n,)."""

    s: np.ndarray  # m, station: distance along the line
    X: np.ndarray  # m
    Y: np.ndarray  # m
    psi: np.ndarray  # rad, heading, continuous
    kappa: np.ndarray  # 1/m, curvature, left positive


class Frame(NamedTuple):
    """A pose on a line, or arrays of them."""

    X: np.ndarray
    Y: np.ndarray
    psi: np.ndarray


def from_curves(curves: Sequence[Curve], X: float, Y: float, psi: float, spacing: float) -> Line:
    """Return curves joined end to end from a pose on, sampled at most `spacing` [m] apart.

    Every joint is a sample; its curvature is the one of the curve that begins there.
    """
    pieces = []
    s = 0.0
    for curve in curves:
        piece = _piece(curve, Line(s, X, Y, psi, 0.0), spacing)
        pieces.append(piece)
        s, X, Y, psi, _ = (column[-1] for column in piece)
    inner = [Line(*(column[:-1] for column in piece)) for piece in pieces[:-1]]
    return Line(*map(np.concatenate, zip(*inner, pieces[-1])))


def _piece(curve, start, spacing):
    s = _divide(curve.length, spacing)
    half = np.diff(s) / 2
    inside = s[:-1, None] + half[:, None] * (NODES + 1)
    psi = start.psi + curve.turn(inside)
    dX, dY = half * (np.cos(psi) @ WEIGHTS), half * (np.sin(psi) @ WEIGHTS)
    return Line(
        start.s + s,
        start.X + _running_sum(dX),
        start.Y + _running_sum(dY),
        start.psi + curve.turn(s),
        curve.kappa(s),
    )


def through_points(points: np.ndarray, spacing: float) -> Line:
    """Return the cubic spline through points (n, 2), sampled at most `spacing` [m] apart.

    Heading and curvature are continuous. The points must not repeat.
    """
    chord = np.hypot(*np.diff(points, axis=0).T)
    spline = scipy.interpolate.CubicSpline(_running_sum(chord), points)
    parts = _running_sum(np.ceil(FINER * chord / spacing))
    fine = np.interp(np.arange(parts[-1] + 1), parts, spline.x)
    half = np.diff(fine) / 2
    inside = fine[:-1, None] + half[:, None] * (NODES + 1)
    speed = np.hypot(*np.moveaxis(spline(inside, 1), -1, 0))
    station = _running_sum(half * (speed @ WEIGHTS))
    s = _divide(station[-1], spacing)
    u = scipy.interpolate.CubicSpline(station, fine)(s)
    (X, Y), (dX, dY), (ddX, ddY) = (spline(u, order).T for order in range(3))
    psi = np.unwrap(np.arctan2(dY, dX))
    return Line(s, X, Y, psi, (dX * ddY - dY * ddX) / np.hypot(dX, dY) ** 3)


def at(line: Line, s: float) -> Frame:
    """Return the pose at stations [m] between 0 and the length of the line."""
    X = scipy.interpolate.CubicHermiteSpline(line.s, line.X, np.cos(line.psi))(s)
    Y = scipy.interpolate.CubicHermiteSpline(line.s, line.Y, np.sin(line.psi))(s)
    return Frame(X, Y, np.interp(s, line.s, line.psi))


def beside(frame: Frame, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return X and Y of the points `offset` [m] to the left of poses."""
    return frame.X - offset * np.sin(frame.psi), frame.Y + offset * np.cos(frame.psi)


def nearest(line: Line, X: float, Y: float) -> int:
    """Return the sample beside a point: of laps that lie on each other, the first."""
    away = np.hypot(line.X - X, line.Y - Y)
    return int(np.argmax(away <= away.min() + np.diff(line.s).max() / 2))


def _divide(length, spacing):
    # a length that is a multiple of the spacing must not get one more interval by rounding
    return np.linspace(0.0, length, 1 + max(1, int(np.ceil(length / spacing - ROUNDING))))


def _running_sum(steps):
    return np.concatenate([[0.0], np.cumsum(steps)])
