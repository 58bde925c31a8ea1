"""The frame in which distances are measured: Cartesian as in the paper, or path coordinates.

A distance frame decides which numbers of obstacles and edges a stage has, and how far a vehicle
circle is from them. The states of the map go with either, so that the effect of the frame can be
separated from the other differences of the baseline. SI units.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from mpcc_controller.path import distance, frenet_frame, road_edges
from mpcc_controller.path.distance import Circle, Disc, Edge, Edges
from mpcc_controller.path.frenet_frame import FrenetDisc, FrenetEdge

EMPTY_SLOT_M = 1e4  # beside the plan: an obstacle there has no priority for any plan


class DistanceFrame(NamedTuple):
    """One frame; its functions take the states of the map."""

    disc: Any  # template of an obstacle in the parameters of a stage
    edges: Any  # template of the road edges
    distances: Callable[[list[Circle], Any], tuple]  # (circles, stage) -> `cartesian_distances`
    obstacle: Callable[[Any, Disc, Any], Any]  # (path, obstacle, plan) -> numbers like `disc`
    empty_slot: Callable[[Any], Any]  # (plan) -> numbers like `disc`
    road: Callable[[Any, Any, Any, float], Any]  # (road, path, plan, window) -> like `edges`


def cartesian_distances(circles: list[Circle], p):
    """Return D_V2O per obstacle and D_V2E per edge [m], each a list over the vehicle's circles."""
    v2o = [[distance.v2o(c, obstacle) for c in circles] for obstacle in p.obstacles]
    at_edges = [c._replace(r=p.body.edge_radius) for c in circles]
    v2e = [list(D) for D in zip(*(distance.v2e(c, p.edges) for c in at_edges))]
    return v2o, v2e


def frenet_distances(circles: list[Circle], p):
    """Return the same in path coordinates of the circles' centres."""
    points = [frenet_frame.to_frenet_on_arc(p.path, c.X, c.Y) for c in circles]
    return frenet_frame.distances(points, p)


CARTESIAN = DistanceFrame(
    disc=Disc(*Disc._fields),
    edges=Edges(*[Edge(*Edge._fields)] * 2),
    distances=cartesian_distances,
    obstacle=lambda path, disc, x: disc,
    empty_slot=lambda x: Disc(x.X, x.Y + EMPTY_SLOT_M, 0.0),
    road=lambda road, pieces, x, window: road_edges.edges_near(road, x.X, x.Y, window),
)
FRENET = DistanceFrame(
    disc=FrenetDisc(*FrenetDisc._fields),
    edges=Edges(*[FrenetEdge(*FrenetEdge._fields)] * 2),
    distances=frenet_distances,
    obstacle=lambda path, disc, x: frenet_frame.disc_to_frenet(path, disc, np.mean(x.theta)),
    empty_slot=lambda x: FrenetDisc(x.theta, EMPTY_SLOT_M, 0.0),
    road=lambda road, pieces, x, window: frenet_frame.edges_to_frenet(road, pieces, window),
)
FRAMES = {'cartesian': CARTESIAN, 'path': FRENET}
