"""Distances in path coordinates, as if the path were straight: the naive ones of the baseline.

Brown & Gerdes' published code measures sqrt(ds^2 + de^2) and the distance to the edges across the
path. Beside a bend both differ from the distance on the ground (docs/baseline.md). SI units;
negative means contact.
"""

from typing import Any, NamedTuple

from mpcc_controller.model import maths
from mpcc_controller.path.distance import CENTRE_ROUNDING
from mpcc_controller.path.path_frame import Place


class PathDisc(NamedTuple):
    """One obstacle at the time of a stage."""

    s: Any  # m
    e: Any  # m
    r_obs: Any  # m


class PathEdge(NamedTuple):
    """A road edge beside a stage: a straight line in path coordinates."""

    s: Any  # m, where it is known
    e: Any  # m, there
    slope: Any  # -, de/ds


class PathEdges(NamedTuple):
    """Both edges of the road beside a stage."""

    left: PathEdge
    right: PathEdge


def v2o(place: Place, radius, obstacle: PathDisc):
    """Return the distance [m] of a circle at `place` to an obstacle."""
    ds, de = place.s - obstacle.s, place.e - obstacle.e
    return maths.sqrt(ds**2 + de**2 + CENTRE_ROUNDING) - obstacle.r_obs - radius


def offset(edge: PathEdge, s):
    """Return where [m] an edge is at `s`, to the left of the path."""
    return edge.e + edge.slope * (s - edge.s)


def v2e(place: Place, radius, edges: PathEdges):
    """Return the distance [m] of a circle at `place` to the left and to the right edge."""
    return (
        offset(edges.left, place.s) - place.e - radius,
        place.e - offset(edges.right, place.s) - radius,
    )


def of_places(places: list[Place], p):
    """Return D_V2O per obstacle and D_V2E per edge [m], each a list over the vehicle's circles.

    `p` holds `body.radius`, `obstacles` and `edges` in path coordinates.
    """
    radius = p.body.radius
    v2o_ = [[v2o(place, radius, obstacle) for place in places] for obstacle in p.obstacles]
    v2e_ = [list(D) for D in zip(*(v2e(place, radius, p.edges) for place in places))]
    return v2o_, v2e_
