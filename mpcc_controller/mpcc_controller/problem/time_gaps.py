"""Who is ahead of a plan, as numbers per stage: what the time gap is kept to. SI units.

A plan keeps a gap in time to those who move in the strip along the path in which it is itself: one
who drives ahead, and one who comes in another lane than that of the path. So the car keeps its
distance from who is ahead, and leaves its lane for an obstacle in it while there is time to return.
"""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from mpcc_controller.parameters import ControllerParams
from mpcc_controller.path import frenet_frame
from mpcc_controller.problem import obstacle_motion
from mpcc_controller.problem.cost_terms import STRIP_BLEND_M
from mpcc_controller.problem.stage_parameters import Scene

STRIPS = ('of the path', 'left of it', 'right of it')
MOVING_MPS = 1.0
COMES = 2.0  # times the gap in which one who comes gets nearer: also the car has to return
FAR_M = 1e6  # nobody is ahead
KNOT_STAGES = 5  # between two projections on the path


class Lead(NamedTuple):
    """Who is ahead of a stage."""

    theta: Any  # m, up to which a car that stands keeps the time gap
    e: Any  # m left of the path, its centre
    reach: Any  # m to either side of that, nearer than which the car is in its strip


def leads(scene: Scene, x, params: ControllerParams) -> tuple[Lead, ...]:
    """Return the next one ahead in each of STRIPS at each stage, each leaf (N + 1,).

    Ahead of the guessed states `x` in the map. On the path the car is in the way of nobody in
    another strip, and who comes in that of the path is an emergency: there is no gap to keep.
    """
    count = len(x.X)
    nobody = Lead(np.full(count, FAR_M), np.zeros(count), np.zeros(count))
    items = scene.obstacles.items
    moving = [row for row, o in enumerate(items) if math.hypot(o.vX, o.vY) > MOVING_MPS]
    if params.tolerances.time_gap_lack_m is None or not moving:
        return (nobody,) * len(STRIPS)
    gap_s, body = params.envelope.time_gap_s or 1.0, params.body
    half = body.circle_radius_m if body.edge_radius_m is None else body.edge_radius_m
    nose = max(body.circle_offsets_m) + body.circle_radius_m
    # projected at some stages only, linear between them
    knots, shares = _interpolation(count)
    dt = params.model.step_s
    X, Y = obstacle_motion.stages(items, count, dt)[:2, moving][:, :, knots]
    at = frenet_frame.to_frenet(scene.path, X.ravel(), Y.ravel(), float(np.mean(x.theta)))
    s, e = (part.reshape(X.shape) @ shares for part in at)
    r_obs = np.array([[items[row].r_obs] for row in moving])
    speed, rear, touch = np.gradient(s, dt, axis=1), s - r_obs - nose, r_obs + half
    comes, beside, wide = speed < -MOVING_MPS, np.abs(e) > touch, touch + STRIP_BLEND_M
    ahead = (rear > x.theta) & (comes | (speed > MOVING_MPS))
    theta = np.where(ahead, rear + COMES * gap_s * np.minimum(speed, 0.0), FAR_M)
    within = np.where(beside, np.minimum(wide, np.abs(e)), wide)
    strips, stages = (~beside & ~comes, beside & (e > 0.0), beside & (e < 0.0)), np.arange(count)
    leads_ahead = []
    for strip in strips:
        own = np.where(strip, theta, FAR_M)
        k = np.argmin(own, axis=0)
        leads_ahead.append(Lead(own[k, stages], e[k, stages], within[k, stages]))
    return tuple(leads_ahead)


@cache
def _interpolation(count):
    """Return every KNOT_STAGES-th stage and the last one, and their shares in each stage."""
    knots = np.unique(np.append(np.arange(0, count, KNOT_STAGES), count - 1))
    shares = [np.interp(np.arange(count), knots, row) for row in np.eye(len(knots))]
    return knots, np.array(shares)
