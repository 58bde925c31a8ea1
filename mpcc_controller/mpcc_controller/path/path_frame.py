"""Coordinates along the coarse path: s along it, e to the left of it (Frenet). SI units.

    s' = (vx cos dpsi - vy sin dpsi) / (1 - kappa e)
    e' = vx sin dpsi + vy cos dpsi
    dpsi' = r - kappa s'

is the motion of a point in them (Brown & Gerdes 2019, section II); kappa is the curvature of the
path, left positive, and dpsi the heading relative to it.
"""

from typing import Any, NamedTuple

import numpy as np

from mpcc_controller.model import maths
from mpcc_controller.path import arc, reference
from mpcc_controller.path.arc import Arc
from mpcc_controller.path.reference import Path

STEPS = 3  # of the projection, each on the arc under the foot found so far
STRAY = 1e-3  # m of distance that a metre along the path counts for, between equally near places


class Place(NamedTuple):
    """A point in path coordinates."""

    s: Any  # m along the path
    e: Any  # m, left of the path positive


class Rates(NamedTuple):
    """The motion of a body in path coordinates."""

    s: Any  # m/s
    e: Any  # m/s
    dpsi: Any  # rad/s


def rates(e, dpsi, kappa, vx, vy, r) -> Rates:
    """Return how path coordinates change; numbers or CasADi expressions.

    They are singular at the centre of the curvature, where 1 = kappa e.
    """
    along = (vx * maths.cos(dpsi) - vy * maths.sin(dpsi)) / (1 - kappa * e)
    return Rates(along, vx * maths.sin(dpsi) + vy * maths.cos(dpsi), r - kappa * along)


def on_arc(piece: Arc, X, Y) -> Place:
    """Return the path coordinates of a point beside an arc; numbers or CasADi expressions.

    With the point `ahead` and `left` of the pose at theta, the radius through it turns by
    atan(turn), turn = kappa ahead / (1 - kappa left), and has the length 1 / kappa - e. Both are
    written so that they hold on a straight path: three terms of the series of atan(turn) / turn
    are off by turn^6 / 7, 1e-7 of the length 2 m ahead on a radius of 20 m.
    """
    pose = arc.Pose(piece.X, piece.Y, piece.psi)
    ahead, left = -arc.lag(pose, X, Y), -arc.contouring(pose, X, Y)
    shrink = 1 - piece.kappa * left
    turn = piece.kappa * ahead / shrink
    reach = maths.sqrt(shrink**2 + (piece.kappa * ahead) ** 2)
    return Place(
        s=piece.theta + ahead / shrink * (1 - turn**2 / 3 + turn**4 / 5),
        e=(2 * left - piece.kappa * (left**2 + ahead**2)) / (1 + reach),
    )


def places(path: Path, X, Y, near: float) -> Place:
    """Return the path coordinates of points (k,); of places equally near those next to s = `near`.

    Before its start and past its end the path goes on straight. A point beyond the centre of a
    bend keeps the foot at the pose of the path next to it.
    """
    return refined(path, X, Y, np.array([_corner(path, *point, near) for point in zip(X, Y)]))


def _corner(path, X, Y, near):
    """Return the theta of the nearer end of the chord next to a point.

    The chord decides, not its ends: on a long one both are far from the foot.
    """
    arcs = Arc(*(column[1:] for column in path.arcs))
    share, inside, square = reference.feet(arcs, X, Y)
    theta = arcs.theta[:-1] + inside * np.diff(arcs.theta)
    best = np.argmin(np.sqrt(square) + STRAY * np.abs(theta - near))
    return arcs.theta[best + int(share[best] > 0.5)]


def refined(path: Path, X, Y, s) -> Place:
    """Return the path coordinates of points (k,) whose feet are known roughly, at `s` (k,)."""
    for _ in range(STEPS):
        piece, _ = reference.at(path, s)
        left = -arc.contouring(arc.Pose(piece.X, piece.Y, piece.psi), X, Y)
        s = np.where(piece.kappa * left < 1, on_arc(piece, X, Y).s, s)
    piece, _ = reference.at(path, s)
    return Place(s, -arc.contouring(arc.Pose(piece.X, piece.Y, piece.psi), X, Y))


def poses(path: Path, place: Place) -> arc.Pose:
    """Return the points of the map at path coordinates (k,), with the heading of the path there."""
    piece, _ = reference.at(path, place.s)
    return beside(arc.Pose(piece.X, piece.Y, piece.psi), place.e)


def beside(pose: arc.Pose, e) -> arc.Pose:
    """Return the pose moved by `e` [m] to its left."""
    return arc.Pose(pose.X - e * np.sin(pose.psi), pose.Y + e * np.cos(pose.psi), pose.psi)
