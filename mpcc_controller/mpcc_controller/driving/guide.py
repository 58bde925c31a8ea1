"""Where to steer to without a plan of this tick: a point some way ahead on an older line."""

from typing import NamedTuple

import numpy as np

from mpcc_controller.driving.braking import Point
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import Braking
from mpcc_controller.path import reference
from mpcc_controller.path.reference import Path
from msgs_yaml.types import VehicleState
from stage_solver.stage_problem import Plan

PLAN, PATH, NONE = 'plan', 'path', 'none'


class Aim(NamedTuple):
    """A point to steer to, and on which line it lies."""

    line: str  # PLAN, PATH or NONE
    point: Point | None


def aim(
    x: VehicleState, plan: Plan | None, path: Path | None, theta: float | None, rules: Braking
) -> Aim:
    """Return a point of the plan ahead of the car; of the path at `theta` without a plan.

    `theta` is the path distance [m] of the car's foot. A state that is not finite has no aim.
    """
    if not np.all(np.isfinite(x)):
        return Aim(NONE, None)
    preview = max(rules.preview_s * x.vx, rules.least_preview_m)
    if plan is not None:
        states = State(*plan.X.T)
        line = np.column_stack((states.X, states.Y))
        return Aim(PLAN, ahead_on(line, x.X, x.Y, preview))
    if path is not None:
        arcs, _ = reference.at(path, theta + preview)
        return Aim(PATH, Point(float(arcs.X), float(arcs.Y)))
    return Aim(NONE, None)


def ahead_on(line: np.ndarray, X: float, Y: float, distance: float) -> Point:
    """Return the point `distance` [m] along a polyline (n, 2) after the foot of (X, Y) on it.

    Past its end the line goes on straight.
    """
    chords = np.diff(line, axis=0)
    lengths = np.hypot(*chords.T)
    chords, starts = chords[lengths > 0], line[:-1][lengths > 0]
    lengths = lengths[lengths > 0]
    if not len(lengths):
        return Point(*map(float, line[-1]))
    directions = chords / lengths[:, None]
    along = np.clip(np.sum((np.array((X, Y)) - starts) * directions, axis=1), 0, lengths)
    away = starts + along[:, None] * directions - (X, Y)
    nearest = np.argmin(np.sum(away**2, axis=1))
    before = np.concatenate(([0], np.cumsum(lengths)))
    s = before[nearest] + along[nearest] + distance
    k = min(np.searchsorted(before, s, side='right'), len(lengths)) - 1
    return Point(*map(float, starts[k] + (s - before[k]) * directions[k]))
