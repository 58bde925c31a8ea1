"""Distances to obstacles and road edges (paper, section 3.3).

Distances are Cartesian, between circles (paper, eq. 3), in metres; negative means contact.
"""

from typing import Any, NamedTuple

from mpcc_controller.path.arc import cos, sin, sqrt

# m^2; rounds the tip of the distance at an obstacle's centre, where it has no gradient
CENTRE_ROUNDING = 1e-6


class Circle(NamedTuple):
    """One circle of the vehicle."""

    X: Any  # m, map; or s of path coordinates, see `frenet_frame`
    Y: Any  # m, map; or e
    r: Any  # m, radius


class Disc(NamedTuple):
    """One obstacle at the time of a stage."""

    X: Any  # m, as those of the circles
    Y: Any  # m
    r_obs: Any  # m


class Edge(NamedTuple):
    """A road edge near a stage: a parabola that touches it at (X, Y), in driving direction."""

    X: Any  # m, map
    Y: Any  # m, map
    psi: Any  # rad, heading of the edge
    kappa: Any  # 1/m, curvature, left positive


class Edges(NamedTuple):
    """Both edges of the road near a stage."""

    left: Edge
    right: Edge


def circle(x, offset, radius) -> Circle:
    """Return the vehicle circle whose centre lies `offset` [m] ahead of the CoG."""
    return Circle(x.X + offset * cos(x.psi), x.Y + offset * sin(x.psi), radius)


def v2o(vehicle: Circle, obstacle: Disc):
    """Return D_V2O [m] (paper, eq. 3)."""
    dX, dY = vehicle.X - obstacle.X, vehicle.Y - obstacle.Y
    return sqrt(dX**2 + dY**2 + CENTRE_ROUNDING) - obstacle.r_obs - vehicle.r


def lateral_offset(vehicle: Circle, edge: Edge):
    """Return how far [m] the circle's centre is to the left of an edge.

    The error of the parabola is kappa^2 d (s^2 / 2) for an along-edge distance s to the touching
    point and a distance d across it: 2 mm for s = 1 m and d = 4 m on a radius of 30 m.
    """
    dX, dY = vehicle.X - edge.X, vehicle.Y - edge.Y
    cos_psi, sin_psi = cos(edge.psi), sin(edge.psi)
    along = cos_psi * dX + sin_psi * dY
    return cos_psi * dY - sin_psi * dX - edge.kappa * along**2 / 2


def v2e(vehicle: Circle, edges: Edges):
    """Return D_V2E [m] to the left and to the right edge."""
    return (
        -lateral_offset(vehicle, edges.left) - vehicle.r,
        lateral_offset(vehicle, edges.right) - vehicle.r,
    )
