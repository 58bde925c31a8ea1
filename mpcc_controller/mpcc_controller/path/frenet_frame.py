"""Path (Frenet) coordinates: s along the coarse path, e to the left of it. SI units.

    s' = (vx cos dpsi - vy sin dpsi) / (1 - kappa e)
    e' = vx sin dpsi + vy cos dpsi
    dpsi' = r - kappa s'

is the motion of a point (Brown & Gerdes 2019, section II); kappa is the curvature of the path, left
positive, and dpsi the heading relative to it. As in the published code of Brown & Gerdes distances
are measured as if (s, e) were Cartesian: to obstacles by `distance.v2o`, whose X and Y are s and e
then, to edges the difference of e. In a bend both differ from the distance on the ground
(docs/paper.md). Negative: contact.
"""

from typing import Any, NamedTuple

import numpy as np

from mpcc_controller.path import arc, compiled_queries, reference_path, road_edges
from mpcc_controller.path.arc import Arc, Pose, cos, sin, sqrt
from mpcc_controller.path.compiled_queries import call
from mpcc_controller.path.distance import Circle, Disc, Edges
from mpcc_controller.path.reference_path import ReferencePath
from mpcc_controller.path.road_edges import Road

EDGE_STEPS = 2  # of the search for an edge on a normal of the path; one is exact for straight lines


class FrenetPoint(NamedTuple):
    """A point in path coordinates."""

    s: Any  # m along the path
    e: Any  # m, left of the path positive


class FrenetRates(NamedTuple):
    """The motion of a body in path coordinates."""

    s: Any  # m/s
    e: Any  # m/s
    dpsi: Any  # rad/s


class FrenetEdge(NamedTuple):
    """A road edge beside a stage: a straight line in path coordinates."""

    s: Any  # m, of a point of the line
    e: Any  # m, of that point
    slope: Any  # -, de/ds


def rates(e, dpsi, kappa, vx, vy, r) -> FrenetRates:
    """Return the rates of path coordinates; numbers or CasADi expressions.

    They are singular at the centre of the curvature, where 1 = kappa e.
    """
    s_rate = (vx * cos(dpsi) - vy * sin(dpsi)) / (1 - kappa * e)
    e_rate = vx * sin(dpsi) + vy * cos(dpsi)
    return FrenetRates(s_rate, e_rate, r - kappa * s_rate)


def to_frenet_on_arc(piece: Arc, X, Y) -> FrenetPoint:
    """Return the path coordinates of a point beside an arc; numbers or CasADi expressions.

    With the point `ahead` and `left` of the pose at theta, the radius through it turns by
    atan(turn), turn = kappa ahead / (1 - kappa left), and has the length 1 / kappa - e. Both are
    written so that they hold on a straight path: three terms of the series of atan(turn) / turn
    have an error of turn^6 / 7, 1e-7 of the length 2 m ahead on a radius of 20 m.
    """
    pose = Pose(piece.X, piece.Y, piece.psi)
    ahead, left = -arc.lag_error(pose, X, Y), arc.contouring_error(pose, X, Y)
    shrink = 1 - piece.kappa * left
    turn = piece.kappa * ahead / shrink
    reach = sqrt(shrink**2 + (piece.kappa * ahead) ** 2)
    return FrenetPoint(
        s=piece.theta + ahead / shrink * (1 - turn**2 / 3 + turn**4 / 5),
        e=(2 * left - piece.kappa * (left**2 + ahead**2)) / (1 + reach),
    )


def to_frenet(path: ReferencePath, X, Y, near: float) -> FrenetPoint:
    """Return the path coordinates of points (k,); of equally close ones those next to s = `near`.

    The path continues straight before its start and past its end. A point beyond the centre of a
    bend keeps the foot at the closest pose of the path.
    """
    X, Y, table = compiled_queries.row(X), compiled_queries.row(Y), path.table
    s, e = np.empty((2, len(X)))
    call('path_to_frenet', table.shape[1], table, path.discs, len(X), X, Y, near, s, e)
    return FrenetPoint(s, e)


def refine(path: ReferencePath, X, Y, s) -> FrenetPoint:
    """Return the path coordinates of points (k,) from approximate values of `s` (k,)."""
    X, Y, s = compiled_queries.row(X), compiled_queries.row(Y), np.array(s, float)
    e = np.empty(len(s))
    call('path_refine', path.table.shape[1], path.table, len(s), X, Y, s, e)
    return FrenetPoint(s, e)


def to_cartesian(path: ReferencePath, point: FrenetPoint) -> Pose:
    """Return the points of the map at path coordinates (k,), with the heading of the path there."""
    piece, _ = reference_path.arcs_at(path, point.s)
    return offset_left(piece, point.e)


def offset_left(pose: Pose | Arc, e) -> Pose:
    """Return the pose, or that of an arc, moved by `e` [m] to its left."""
    return Pose(pose.X - e * np.sin(pose.psi), pose.Y + e * np.cos(pose.psi), pose.psi)


# distances


def edge_offset(edge: FrenetEdge, s):
    """Return the offset e [m] of an edge at `s`, to the left of the path."""
    return edge.e + edge.slope * (s - edge.s)


def v2e(vehicle: Circle, edges: Edges):
    """Return the distances [m] of a vehicle circle at (s, e) to the left and the right edge."""
    s, e, radius = vehicle
    return (
        edge_offset(edges.left, s) - e - radius,
        e - edge_offset(edges.right, s) - radius,
    )


# obstacles and edges as numbers per stage


def disc_to_frenet(path: ReferencePath, obstacle: Disc, near: float) -> Disc:
    """Return an obstacle (k,) at (s, e); of several solutions those next to s = `near`.

    The coordinates of one that does not move have the shape (1,).
    """
    moves = np.ptp(obstacle.X) > 0 or np.ptp(obstacle.Y) > 0
    rows = slice(None) if moves else slice(1)  # one projection is enough
    point = to_frenet(path, obstacle.X[rows], obstacle.Y[rows], near)
    return Disc(*point, obstacle.r_obs)


def edges_to_frenet(road: Road, pieces: Arc, window: float) -> Edges:
    """Return both edges beside points of the path (k,): where the normals of the path cross them.

    `window` [m] is that of `road_edges.edge_beside`. The point of an edge closest to the path need
    not be on the normal: where the two are not parallel the search starts again at the crossing.
    """
    pose, edges = Pose(pieces.X, pieces.Y, pieces.psi), []
    for line in road:
        crossing = pose
        for _ in range(EDGE_STEPS):
            edge = road_edges.edge_beside(line, crossing.X, crossing.Y, window)
            ahead = -arc.lag_error(pose, edge.X, edge.Y)
            tangent = np.tan(edge.psi - pose.psi)
            e = arc.contouring_error(pose, edge.X, edge.Y)
            e = e - ahead * tangent + edge.kappa * ahead**2 / 2
            crossing = offset_left(pose, e)
        edges.append(FrenetEdge(pieces.theta, e, (1 - pieces.kappa * e) * tangent))
    return Edges(*edges)
