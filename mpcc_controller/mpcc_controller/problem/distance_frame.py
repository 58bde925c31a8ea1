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
from mpcc_controller.path.frenet_frame import FrenetEdge

EMPTY_SLOT_M = 1e4  # beside the plan: an obstacle there has no priority for any plan


class DistanceFrame(NamedTuple):
    """One frame; its functions take the states of the map."""

    edges: Any  # template of the road edges in the parameters of a stage
    distances: Callable[[list[Circle], Any], tuple]  # (circles, stage) -> as `distances`
    obstacle: Callable[[Any, Disc, Any], Disc]  # (path, obstacle, plan) -> the same in this frame
    empty_slot: Callable[[Any], Disc]  # (plan) -> an obstacle far away
    road: Callable[[Any, Any, Any, float], Any]  # (road, path, plan, window) -> like `edges`


def distances(circles: list[Circle], p, v2e: Callable = distance.v2e):
    """Return D_V2O per obstacle and D_V2E per edge [m], each a list over the vehicle's circles.

    `p` holds `body`, `obstacles` and `edges`; circles and obstacles are in the frame of `v2e`.
    """
    v2o = [[distance.v2o(c, obstacle) for c in circles] for obstacle in p.obstacles]
    at_edges = [c._replace(r=p.body.edge_radius) for c in circles]
    return v2o, [list(D) for D in zip(*(v2e(c, p.edges) for c in at_edges))]


def frenet_distances(circles: list[Circle], p):
    """Return the same in path coordinates of the circles' centres."""
    moved = [Circle(*frenet_frame.to_frenet_on_arc(p.path, c.X, c.Y), c.r) for c in circles]
    return distances(moved, p, frenet_frame.v2e)


CARTESIAN = DistanceFrame(
    edges=Edges(*[Edge(*Edge._fields)] * 2),
    distances=distances,
    obstacle=lambda path, disc, x: disc,
    empty_slot=lambda x: Disc(x.X, x.Y + EMPTY_SLOT_M, 0.0),
    road=lambda road, pieces, x, window: road_edges.edges_near(road, x.X, x.Y, window),
)
FRENET = DistanceFrame(
    edges=Edges(*[FrenetEdge(*FrenetEdge._fields)] * 2),
    distances=frenet_distances,
    obstacle=lambda path, disc, x: frenet_frame.disc_to_frenet(path, disc, np.mean(x.theta)),
    empty_slot=lambda x: Disc(x.theta, EMPTY_SLOT_M, 0.0),
    road=lambda road, pieces, x, window: frenet_frame.edges_to_frenet(road, pieces, window),
)
FRAMES = {'cartesian': CARTESIAN, 'path': FRENET}
