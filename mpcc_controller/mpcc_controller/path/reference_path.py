"""The behaviour planner's path as arcs: strict checks, projection, evaluation. SI units."""

from typing import NamedTuple

import numpy as np

from mpcc_controller.path import compiled_queries
from mpcc_controller.path.arc import Arc
from msgs_yaml.types import Reference

STOP_MPS = 1.0  # a path whose desired speed ends at most at this ends in a stop
PATH_SPEED = 'surroundings.path_speed_mps'  # parameter


class PathError(ValueError):
    """The path cannot be driven; the text names the pose and what is wrong."""


class ReferencePath(NamedTuple):
    """A path of n segments and its straight continuations: n + 2 arcs in order."""

    table: np.ndarray  # (6, n + 2): the rows of `arcs`, then `v`
    discs: np.ndarray  # of `compiled_queries`

    @property
    def arcs(self) -> Arc:
        """The arcs, each field (n + 2,): the start of the arc, but the end of the first one."""
        return Arc(*self.table[:-1])

    @property
    def v(self) -> np.ndarray:
        """The desired speed (n + 2,) [m/s]."""
        return self.table[-1]

    @property
    def length(self) -> float:
        """The length [m] without the continuations."""
        return float(self.table[-2, -1])

    @property
    def ends_in_stop(self) -> bool:
        """Whether the car is to stand past the end: the desired speed there is 0."""
        return self.v[-1] == 0

    def __repr__(self):
        return f'ReferencePath({self.table.shape[1] - 2} segments, {self.length:.1f} m)'


def build(reference: Reference, speed_mps: float | None = None) -> ReferencePath:
    """Check a path and divide it into arcs.

    A path whose poses have one stamp has the desired speed `speed_mps` [m/s] everywhere. It ends in
    a stop if its last pose repeats the place of the one before it, or if its desired speed ends at
    STOP_MPS or less. Raises `PathError` for fewer than two poses, numbers that are not finite,
    other repeated poses, stamps that do not increase, a heading against the driving direction,
    doubling back, and no speed at all.
    """
    names = ('X', 'Y', 'psi', 't')
    X, Y, psi, t = (np.asarray(getattr(reference, name), float) for name in names)
    if not X.shape == Y.shape == psi.shape == t.shape or X.ndim != 1 or X.size < 2:
        raise PathError(f'a path needs two poses or more, with equal columns; it has {X.shape}')
    for name, column in zip(names, (X, Y, psi, t)):
        _require(np.isfinite(column), f'{name} is not finite')
    dX, dY, dt = np.diff(X), np.diff(Y), np.diff(t)
    chord = np.hypot(dX, dY)
    has_stamps = bool(np.any(dt))
    if has_stamps:
        _require(dt > 0, 'the stamp does not increase after it')
    elif speed_mps is None:
        raise PathError(
            'all poses have the same stamp, which says no desired speed; the parameter '
            f'{PATH_SPEED} gives one (m/s)'
        )
    # later divided by: a square that underflows counts as no distance
    stops = chord[-1] ** 2 == 0 and has_stamps and X.size > 2
    if stops:
        X, Y, psi = X[:-1], Y[:-1], psi[:-1]
        dX, dY, dt, chord = dX[:-1], dY[:-1], dt[:-1], chord[:-1]
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
    v = ds / dt if has_stamps else np.full(len(ds), speed_mps)
    last = 0.0 if stops or v[-1] <= STOP_MPS else v[-1]
    table = np.array((*arcs, np.concatenate((v[:1], v, [last]))))
    return ReferencePath(table, compiled_queries.make_discs(X, Y))


def arcs_at(path: ReferencePath, theta) -> tuple[Arc, np.ndarray]:
    """Return the arcs tangent to the path at `theta` [m] (k,), and the desired speeds [m/s] (k,).

    The path continues straight before its start and past its end.
    """
    theta, table = compiled_queries.row(theta), path.table
    out = np.empty((5, *theta.shape))
    compiled_queries.call('path_at', table.shape[1], table, theta.size, theta, out)
    X, Y, psi, kappa, v = out
    return Arc(X, Y, psi, kappa, theta), v


def project(path: ReferencePath, X: float, Y: float, near: float | None, reach: float) -> float:
    """Return theta [m] of the point of the path closest to (X, Y).

    With `near` only the path within `reach` [m] of that theta is searched, so that a path that
    crosses or repeats itself is not short-cut. With None all of it is searched; of several laps the
    first one about as close as any, to 1 m, is taken. Past either end the path continues straight.
    """
    near, table = np.nan if near is None else near, path.table
    return compiled_queries.call('path_project', table.shape[1], table, X, Y, near, reach)


def _wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _require(valid, message):
    if not np.all(valid):
        raise PathError(f'pose {int(np.argmin(valid))}: {message}')
