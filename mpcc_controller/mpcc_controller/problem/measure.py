"""Where distances are measured: on the ground, as the paper does, or along the coarse path.

A measure decides what obstacles and edges are in the numbers of a stage and how far a vehicle
circle is from them. The paper's states go with either, so that the effect of the frame of the
distances can be told apart from that of everything else in the baseline. SI units.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from mpcc_controller.path import distance, path_distance, path_frame, path_scene, road
from mpcc_controller.path.distance import Circle, Disc, Edge, Edges
from mpcc_controller.path.path_distance import PathDisc, PathEdge, PathEdges

EMPTY_SLOT = 1e4  # m beside the plan: an obstacle there has no priority, wherever the plan goes


class Measure(NamedTuple):
    """One way to measure; its functions take the states of the map."""

    disc: Any  # template of an obstacle in the numbers of a stage
    edges: Any  # template of the road edges
    distances: Callable[[list[Circle], Any], tuple]  # (circles, stage) -> see `on_the_ground`
    obstacle: Callable[[Any, Disc, Any], Any]  # (path, obstacle, plan) -> numbers like `disc`
    nowhere: Callable[[Any], Any]  # (plan) -> numbers of an empty slot
    road: Callable[[Any, Any, Any, float], Any]  # (road, path, plan, window) -> like `edges`


def on_the_ground(circles: list[Circle], p):
    """Return D_V2O per obstacle and D_V2E per edge [m], each a list over the vehicle's circles."""
    v2o = [[distance.v2o(c, obstacle) for c in circles] for obstacle in p.obstacles]
    v2e = [list(D) for D in zip(*(distance.v2e(c, p.edges) for c in circles))]
    return v2o, v2e


def along_the_path(circles: list[Circle], p):
    """Return the same, measured in the path coordinates of the circles' centres."""
    places = [path_frame.on_arc(p.path, c.X, c.Y) for c in circles]
    return path_distance.of_places(places, p)


CARTESIAN = Measure(
    disc=Disc(*Disc._fields),
    edges=Edges(*[Edge(*Edge._fields)] * 2),
    distances=on_the_ground,
    obstacle=lambda path, disc, x: disc,
    nowhere=lambda x: Disc(x.X, x.Y + EMPTY_SLOT, 0.0),
    road=lambda edges, pieces, x, window: road.near_plan(edges, x.X, x.Y, window),
)
PATH = Measure(
    disc=PathDisc(*PathDisc._fields),
    edges=PathEdges(*[PathEdge(*PathEdge._fields)] * 2),
    distances=along_the_path,
    obstacle=lambda path, disc, x: path_scene.disc(path, disc, np.mean(x.theta)),
    nowhere=lambda x: PathDisc(x.theta, EMPTY_SLOT, 0.0),
    road=lambda edges, pieces, x, window: path_scene.edges(edges, pieces, window),
)
