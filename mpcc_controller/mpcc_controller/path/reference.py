"""The behaviour planner's path as arcs: strict check, projection, numbers per stage. SI units."""

from typing import NamedTuple

import numpy as np

from mpcc_controller.path import arc
from mpcc_controller.path.arc import Arc
from msgs_yaml.types import Reference

# how much farther than another lap one may seem to be: the chords of laps do not coincide
SAME_PLACE_M = 0.5
NEWTON_STEPS = 3  # of the projection on an arc; each squares the error, which starts below 1 m


class PathError(ValueError):
    """The path cannot be driven; the text says which pose is wrong."""


class Path(NamedTuple):
    """A path of n segments and the straight lines that continue it: n + 2 arcs in order."""

    arcs: Arc  # each field (n + 2,): the start of the arc, but the end of the first one
    v: np.ndarray  # (n + 2,) m/s, desired speed
    length: float  # m


def build(reference: Reference) -> Path:
    """Check a path and cut it into arcs.

    Raises `PathError` for fewer than two poses, numbers that are not finite, repeated poses,
    stamps that do not increase, a heading against the driving direction, or doubling back.
    """
    X, Y, psi, t = (np.asarray(column, float) for column in reference[1:])
    if not X.shape == Y.shape == psi.shape == t.shape or X.ndim != 1 or X.size < 2:
        raise PathError(f'a path needs two poses or more, with equal columns; it has {X.shape}')
    for name, column in zip(reference._fields[1:], (X, Y, psi, t)):
        _require(np.isfinite(column), f'{name} is not finite')
    dX, dY, dt = np.diff(X), np.diff(Y), np.diff(t)
    chord = np.hypot(dX, dY)
    _require(dt > 0, 'the stamp does not increase after it')
    # the square of a distance is divided by: one that underflows is none
    _require(chord**2 > 0, 'the next pose is at the same place')
    along = np.arctan2(dY, dX)
    _require(np.abs(_wrap(np.diff(along))) < np.pi / 2, 'the path doubles back after it')
    _require(np.abs(_wrap(psi[:-1] - along)) < np.pi / 2, 'its heading points backwards')
    _require(np.abs(_wrap(psi[1:] - along)) < np.pi / 2, 'the next heading points backwards')

    turn = _wrap(np.diff(psi))
    along = np.unwrap(along)
    ds = chord / np.sinc(turn / (2 * np.pi))
    theta = np.concatenate(([0], np.cumsum(ds)))
    start, end = along[0] - turn[0] / 2, along[-1] + turn[-1] / 2
    arcs = Arc(
        X=np.concatenate((X[:1], X)),
        Y=np.concatenate((Y[:1], Y)),
        psi=np.concatenate(([start], along - turn / 2, [end])),
        kappa=np.concatenate(([0], turn / ds, [0])),
        theta=np.concatenate((theta[:1], theta)),
    )
    v = ds / dt
    return Path(arcs, np.concatenate((v[:1], v, v[-1:])), float(theta[-1]))


def at(path: Path, theta) -> tuple[Arc, np.ndarray]:
    """Return the arcs that touch the path at `theta` [m] (k,), and the desired speeds [m/s] (k,).

    Before the start and past the end the path goes on straight.
    """
    theta = np.asarray(theta, float)
    # the first arc holds for every theta below 0, the last one past the end
    index = np.searchsorted(path.arcs.theta[1:], theta, side='right')
    piece = Arc(*(column[index] for column in path.arcs))
    pose = arc.at(piece, theta)
    return Arc(pose.X, pose.Y, pose.psi, piece.kappa, theta), path.v[index]


def project(path: Path, X: float, Y: float, near: float | None, reach: float) -> float:
    """Return theta [m] of the point of the path next to (X, Y).

    With `near` only the path within `reach` [m] of that theta counts, so that a path that comes
    back to the same place is not short-cut. With None all of it counts; where it passes several
    times, as on laps, the first time within SAME_PLACE_M of the nearest.
    """
    arcs = path.arcs
    first, last = 1, arcs.theta.size - 1
    if near is not None:
        first = np.clip(np.searchsorted(arcs.theta, near - reach) - 1, first, last - 1)
        last = np.clip(np.searchsorted(arcs.theta, near + reach) + 1, first + 1, last)
    nodes = slice(first, last + 1)
    share, inside, square = feet(Arc(*(column[nodes] for column in arcs)), X, Y)
    best = np.argmin(square) if near is not None else _first_pass(np.sqrt(square))
    # past either end of the path its straight continuation counts
    if best == 0 or best == len(share) - 1:
        inside[best] = share[best]
    theta = arcs.theta[first + best] + inside[best] * np.diff(arcs.theta[nodes])[best]
    return _refine(path, X, Y, float(theta))


def _first_pass(away):
    """Return the nearest segment of the first stretch of path that is about as near as any."""
    close = away <= away.min() + SAME_PLACE_M
    first = np.argmax(close)
    left = np.argmin(close[first:])  # 0: never
    stretch = away[first : first + left] if left else away[first:]
    return first + np.argmin(stretch)


def feet(corners: Arc, X: float, Y: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the foot of a point on the chord between every two corners of a path (n,).

    As a share of the chord, free and inside it, (n - 1,), and its distance^2 [m^2] from the point.
    """
    corners = np.column_stack((corners.X, corners.Y))
    chords = np.diff(corners, axis=0)
    away = np.array((X, Y)) - corners[:-1]
    share = np.sum(away * chords, axis=1) / np.sum(chords**2, axis=1)
    inside = np.clip(share, 0, 1)
    return share, inside, np.sum((away - inside[:, None] * chords) ** 2, axis=1)


def _refine(path, X, Y, theta):
    """Follow the arc until the point is neither ahead of the pose nor behind it."""
    for _ in range(NEWTON_STEPS):
        piece, _ = at(path, theta)
        pose = arc.at(piece, theta)
        left = -arc.contouring(pose, X, Y)
        shrink = 1 - piece.kappa * left
        if shrink <= 0:  # the point lies beyond the centre of the arc: no foot to go to
            break
        theta = theta - arc.lag(pose, X, Y) / shrink
    return float(theta)


def _wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _require(good, complaint):
    if not np.all(good):
        raise PathError(f'pose {int(np.argmin(good))}: {complaint}')


def is_same(one: Path, other: Path) -> bool:
    """Tell whether two paths are equal, number by number."""
    columns = zip((*one.arcs, one.v), (*other.arcs, other.v))
    return all(np.array_equal(a, b) for a, b in columns)
