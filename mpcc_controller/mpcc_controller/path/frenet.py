"""Distances in the coordinates of the coarse path, as baselines measure them. SI units.

The paper compares this distance with the Cartesian one: beside a path that bends the two differ.
It decides nothing here; it is told beside the distance that does.
"""

from typing import NamedTuple

import numpy as np

from mpcc_controller.path import arc, reference
from mpcc_controller.path.reference import Path


class Place(NamedTuple):
    """A point in path coordinates."""

    s: float  # m along the path
    e: float  # m, positive to the left of it


def place(path: Path, X: float, Y: float, near: float) -> Place:
    """Return the path coordinates of a point; of several, those nearest to s = `near` [m]."""
    s = reference.project(path, X, Y, reference.lap(path, X, Y, near), 0.0)
    arcs, _ = reference.at(path, s)
    return Place(s, -float(arc.contouring(arc.Pose(arcs.X, arcs.Y, arcs.psi), X, Y)))


def v2o(vehicle: Place, obstacle: Place, r: float, r_obs: float) -> float:
    """Return the distance [m] of two circles of radius `r` and `r_obs` in path coordinates."""
    return float(np.hypot(vehicle.s - obstacle.s, vehicle.e - obstacle.e)) - r - r_obs
