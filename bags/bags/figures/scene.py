"""A run from above as a list of shapes, computed once for every view of it.

The figures and the film draw the shapes with Matplotlib, `report.page` on the page, and
`markers_node` as markers. Positions are in the frame map [m].

road_shapes, obstacle_shapes, car_shapes   of values, wherever they come from
states_at, positions_at                    of a recorded run, at any times
shapes_at                                  all that moves in a run, at a time
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bags.evaluation import geometry
from bags.evaluation.drive import PREDICTION, obstacle_position
from bags.evaluation.geometry import Outline, transform_to_map
from bags.evaluation.metrics.registry import EvaluatedDrive
from msgs_yaml.conversions import NS_PER_S

WHEEL_M = (0.65, 0.24)  # length and width, as drawn
TRAIL_S = 0.02  # between two points of the line that the car has driven
STAGE_EVERY = 2  # of the stages of a plan one in this many is drawn
FAR_M = 1e3  # of an obstacle that there is not


class Shape(NamedTuple):
    """One shape; kind and number tell it apart."""

    kind: str
    points: np.ndarray  # (n, 2) of a line or of the corners of an area; (2,) the centre of a disc
    radius: float = 0.0  # of a disc
    number: int = 0


def road_shapes(
    left: np.ndarray, right: np.ndarray, keep_off: float, path: np.ndarray | None = None
) -> list[Shape]:
    """Return the road between its edges (n, 2), and the strips and lines that a centre keeps off.

    They are `road`, `strip`, `limit` and `edge` of either side, and `path`.
    """
    shapes = [Shape('road', np.concatenate([left, right[::-1]]))]
    for k, (edge, inside) in enumerate(((left, -1.0), (right, 1.0))):
        limit = geometry.offset_polyline(edge, inside * keep_off)
        strip = np.concatenate([edge, limit[::-1]])
        shapes += [Shape('strip', strip, 0.0, k), Shape('limit', limit, 0.0, k)]
        shapes.append(Shape('edge', edge, 0.0, k))
    return shapes if path is None else [*shapes, Shape('path', path)]


def obstacle_shapes(
    number: int, centre, radius: float, own: float, safe: float, disc: int = 0
) -> list[Shape]:
    """Return the discs `unsafe`, `touch` and `obstacle` of a disc of an obstacle.

    The centre of a car's circle, of radius `own`, must stay out of the first two. The number of the
    shapes is that of the obstacle, of its further discs one that no other has up to ids of 2^24.
    """
    touch, centre, number = radius + own, np.asarray(centre), number ^ disc << 24
    reaches = {'unsafe': touch + safe, 'touch': touch, 'obstacle': radius}
    return [Shape(kind, centre, reach, number) for kind, reach in reaches.items()]


def car_shapes(
    x: float, y: float, yaw: float, outline: Outline, circles: Sequence[float] = (), own=0.0
) -> list[Shape]:
    """Return the `outline` of a car, front left first, and its discs `circle` of radius `own`."""
    shapes = [Shape('outline', transform_to_map(outline.corners, x, y, yaw))]
    middles = np.column_stack([circles, np.zeros(len(circles))])
    centres = transform_to_map(middles, x, y, yaw)
    return shapes + [Shape('circle', at, own, k) for k, at in enumerate(centres)]


def box(size: tuple[float, float]) -> np.ndarray:
    """Return the corners (4, 2) of a rectangle around the origin."""
    return np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * np.divide(size, 2)


def states_at(run: EvaluatedDrive, t: np.ndarray) -> dict[str, np.ndarray]:
    """Return x, y [m], yaw, steer [rad], speed, station and `nearest` [m] at times t (n,) [s].

    `nearest` is the distance of the circles to an obstacle, FAR_M without any. Before the run and
    after it the car stands still.
    """
    motion, inputs, series = run.drive.motion, run.drive.inputs, run.series
    steer = np.zeros(len(series.t))
    if inputs.stamp_ns.size:
        steer = np.interp(motion.stamp_ns, inputs.stamp_ns, inputs.steer)
    gaps = np.fmin.reduce([np.full(len(series.t), np.inf), *series.v2o.values()])
    columns = {
        'x': motion.x,
        'y': motion.y,
        'yaw': np.unwrap(motion.yaw),
        'steer': steer,
        'speed': series.speed,
        'station': series.station,
        'nearest': np.minimum(gaps, FAR_M),
    }
    return {name: np.interp(t, series.t, column) for name, column in columns.items()}


def positions_at(run: EvaluatedDrive, t: np.ndarray) -> np.ndarray:
    """Return the positions (k, 2, n) [m] of the discs at times t (n,) [s] since the start."""
    scene = run.drive.scene
    stamp_ns = run.stamp_ns[0] + np.round(t * NS_PER_S).astype(np.int64)
    each = [obstacle_position(obstacle, scene, stamp_ns) for obstacle in scene.obstacles]
    return np.array(each).reshape(len(each), 2, len(t))


def shapes_at(run: EvaluatedDrive, t: float) -> list[Shape]:
    """Return all that moves in a run at a time t [s]; after its end the last state stays.

    They are the discs of each obstacle, the `trail` that was driven, the `plan`, the `body` of the
    car, which is bevelled so that one sees where it points, its wheels and circles.
    """
    facts, motion, scene = run.drive.facts, run.drive.motion, run.drive.scene
    shapes = []
    places = positions_at(run, np.array([min(t, run.series.t[-1])]))[..., 0]
    for obstacle, place in zip(scene.obstacles, places):
        own, safe = facts.vehicle_radius, facts.safe_obstacle
        shapes += obstacle_shapes(obstacle.id, place, obstacle.radius, own, safe, obstacle.disc)
    now_ns = motion.stamp_ns[0] + round(t * NS_PER_S)
    step = float(np.median(np.diff(run.series.t))) if len(run.series.t) > 1 else TRAIL_S
    past = np.searchsorted(motion.stamp_ns, now_ns, side='right')
    driven = slice(0, past, max(1, round(TRAIL_S / step)))
    plans = [plan for plan in run.sent(PREDICTION) if plan.stamp_ns <= now_ns]
    plan = np.empty((0, 2))
    if plans:
        plan = np.column_stack([plans[-1].X, plans[-1].Y])[::STAGE_EVERY]
    shapes.append(Shape('trail', np.column_stack([motion.x[driven], motion.y[driven]])))
    shapes.append(Shape('plan', plan))
    at = {name: float(column[0]) for name, column in states_at(run, np.array([t])).items()}
    pose, outline, half = (at['x'], at['y'], at['yaw']), facts.outline, facts.outline.width / 2
    nose = [[outline.front - 0.5 * half, half], [outline.front, 0.55 * half]]
    left = np.array([[-outline.rear, half], *nose])
    shapes.append(
        Shape('body', transform_to_map(np.concatenate([left, left[::-1] * [1, -1]]), *pose))
    )
    wheels = facts.wheels
    if not wheels:
        ahead = 0.6 * outline.front, -0.6 * outline.rear
        wheels = [(x, side * (half - WHEEL_M[1] / 2)) for x in ahead for side in (1.0, -1.0)]
    for k, place in enumerate(wheels):
        turned = transform_to_map(box(WHEEL_M), *place, at['steer'] if place[0] > 0 else 0.0)
        shapes.append(Shape('wheel', transform_to_map(turned, *pose), 0.0, k))
    return shapes + car_shapes(*pose, outline, facts.circles, facts.vehicle_radius)[1:]
