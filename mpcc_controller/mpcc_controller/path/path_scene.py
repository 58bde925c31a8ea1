"""Obstacles and road edges in path coordinates, as numbers per stage. SI units."""

import numpy as np

from mpcc_controller.path import arc, distance, path_frame, road
from mpcc_controller.path.arc import Arc
from mpcc_controller.path.distance import Disc
from mpcc_controller.path.path_distance import PathDisc, PathEdge, PathEdges
from mpcc_controller.path.reference import Path
from mpcc_controller.path.road import Road

PASSES = 2  # of the search for the edge on a normal of the path; one is exact for straight lines


def disc(path: Path, obstacle: Disc, near: float) -> PathDisc:
    """Return an obstacle (k,) in path coordinates; of several places those next to s = `near`.

    One that rests has one place, (1,).
    """
    moves = np.ptp(obstacle.X) > 0 or np.ptp(obstacle.Y) > 0
    points = slice(None) if moves else slice(1)  # one that rests is looked for once
    place = path_frame.places(path, obstacle.X[points], obstacle.Y[points], near)
    return PathDisc(place.s, place.e, obstacle.r_obs)


def edges(scene: Road, pieces: Arc, window: float) -> PathEdges:
    """Return both edges beside points of the path (k,): the lines across it that they cross."""
    return PathEdges(*(_edge(line, pieces, window) for line in scene))


def _edge(line, pieces, window):
    """Follow the normal of the path to the edge.

    The point of the edge next to the path need not lie on the normal: where the two are not
    parallel the search begins anew at the crossing.
    """
    here = arc.Pose(pieces.X, pieces.Y, pieces.psi)
    crossing = here
    for _ in range(PASSES):
        touching = road.touching(line, road.nearest(line, crossing.X, crossing.Y), window)
        e, slope = _across(here, pieces.kappa, touching)
        crossing = path_frame.beside(here, e)
    return PathEdge(pieces.theta, e, slope)


def _across(here, kappa, edge: distance.Edge):
    """Return where the normal crosses an edge's tangent, and de/ds of the edge there."""
    ahead, left = -arc.lag(here, edge.X, edge.Y), -arc.contouring(here, edge.X, edge.Y)
    tangent = np.tan(edge.psi - here.psi)
    e = left - ahead * tangent + edge.kappa * ahead**2 / 2
    return e, (1 - kappa * e) * tangent
