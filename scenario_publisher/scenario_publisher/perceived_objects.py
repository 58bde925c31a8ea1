"""Objects of other programs as obstacles and predictions of the contract. No ROS.

Of autoware_perception_msgs/PredictedObjects and derived_object_msgs/ObjectArray in the frame `map`.
A box becomes the fewest equal discs in a row that cover it and stick out beside it by at most
`overhang_m`: nothing of the box is outside of its discs. An object without a size is refused alone.
"""

import math
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np

from msgs_yaml.conversions import stamp_to_ns
from msgs_yaml.strict_yaml import Choice, Range, Struct
from msgs_yaml.types import Branch, Obstacle, Obstacles, Predictions, Refusal

TYPES = ('autoware_perception_msgs/PredictedObjects', 'derived_object_msgs/ObjectArray')
MOST_DISCS = 16  # of one obstacle, as topics.yaml allows
CYLINDER, POLYGON = 1, 2  # autoware_perception_msgs/Shape
# shape_msgs/SolidPrimitive: where box, sphere, cylinder and cone have length and width, or radius
BOX, SIZES_AT = 1, {1: slice(0, 2), 2: slice(0, 1), 3: slice(1, 2), 4: slice(1, 2)}
MOST_ID = 0x7FFFFFFF  # of a marker, which has 31 bits for it


class ConverterParams(Struct):
    """Parameters of converter_node besides `mode`."""

    topic: str  # of the objects
    type: Annotated[str, Choice(*TYPES)]
    overhang_m: Annotated[float, Range(0.01, 2.0, 'm that discs may stick out beside a box')]


def cover(length: float, width: float, overhang: float) -> tuple[np.ndarray, float]:
    """Return the discs of a box [m]: ahead and left (k, 2), the middle one first; their radius."""
    across, along = sorted((length, width))
    half = math.sqrt(overhang * (across + overhang))  # of what a disc covers over the whole width
    count = min(max(1, math.ceil(along / (2.0 * half))), MOST_DISCS)
    places = sorted((along / count * (k - (count - 1) / 2) for k in range(count)), key=abs)
    row = np.outer(places, (1.0, 0.0) if length >= width else (0.0, 1.0))
    return row, math.hypot(along / count, across) / 2.0


def body(is_box: bool, sizes: Sequence[float], overhang: float) -> tuple[np.ndarray, float]:
    """Return the discs of a box of two sizes, or of what has these radii; raise ValueError."""
    if len(sizes) < 1 + is_box or not all(0.0 <= size < math.inf for size in sizes):
        what = 'length and width' if is_box else 'a radius'
        raise ValueError(f'its sizes are {[*sizes]} m; allowed {what}, finite, 0 or more')
    return cover(*sizes, overhang) if is_box else (np.zeros((1, 2)), max(sizes))


def turned(pose: Any, offsets: np.ndarray) -> np.ndarray:
    """Return vectors (..., 2) of the frame of a pose, which may be tilted, in the map."""
    q = pose.orientation
    psi = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    return offsets @ np.array([[math.cos(psi), math.sin(psi)], [-math.sin(psi), math.cos(psi)]])


def obstacle(number: int, pose: Any, row: np.ndarray, radius: float, v: np.ndarray) -> Obstacle:
    """Return an object of discs at a pose with a velocity in the map [m/s]."""
    first, *others = turned(pose, row).tolist()
    X, Y = pose.position.x + first[0], pose.position.y + first[1]
    further = tuple((x - first[0], y - first[1]) for x, y in others)
    return Obstacle(number, X, Y, float(radius), *map(float, v), further)


def from_autoware(message: Any, overhang: float) -> tuple[Obstacles, Predictions]:
    """Return the obstacles of a PredictedObjects and their predictions.

    Ids are 31 bits of the UUIDs. Velocities are in the frames of the objects; the covariance of a
    position holds along the predicted paths, which have none of their own.
    """
    stamp_ns, items, by_id, refused = stamp_to_ns(message.header.stamp), [], {}, []
    for item in message.objects:
        motion, size, kind = item.kinematics, item.shape.dimensions, item.shape.type
        start, v = motion.initial_pose_with_covariance, motion.initial_twist_with_covariance.twist
        sizes = [size.x / 2.0] if kind == CYLINDER else [size.x, size.y]
        if kind == POLYGON:
            sizes = [math.hypot(p.x, p.y) for p in item.shape.footprint.points]
        number = int.from_bytes(bytes(item.object_id.uuid)[:4], 'big') >> 1
        try:
            row, radius = body(kind not in (CYLINDER, POLYGON), sizes, overhang)
        except ValueError as error:
            refused.append(Refusal('shape', f'object {number}: {error}'))
            continue
        velocity = turned(start.pose, np.array([v.linear.x, v.linear.y]))
        items.append(obstacle(number, start.pose, row, radius, velocity))
        paths = [path for path in motion.predicted_paths if len(path.path) and path.confidence > 0]
        whole = max(1.0, sum(path.confidence for path in paths))
        P = np.array([start.covariance[:2], start.covariance[6:8]])
        for path in paths:
            centres = np.array([(pose.position.x, pose.position.y) for pose in path.path])
            XY = centres + [turned(pose, row[0]) for pose in path.path]
            t = np.arange(len(XY)) * (path.time_step.sec + path.time_step.nanosec * 1e-9)
            P_n = np.tile(P, (len(XY), 1, 1))
            branch = Branch(stamp_ns, path.confidence / whole, t, *XY.T, P_n)
            by_id[number] = (*by_id.get(number, ()), branch)
    return Obstacles(stamp_ns, tuple(items), tuple(refused)), Predictions(stamp_ns, by_id)


def from_derived(message: Any, overhang: float) -> tuple[Obstacles, Predictions]:
    """Return the obstacles of an ObjectArray, with velocities in the map; none is predicted."""
    stamp_ns, items, refused = stamp_to_ns(message.header.stamp), [], []
    for item in message.objects:
        kind, v = item.shape.type, item.twist.linear
        sizes = item.shape.dimensions[SIZES_AT.get(kind, slice(0))]
        try:
            discs = body(kind == BOX, sizes, overhang)
            items.append(obstacle(item.id & MOST_ID, item.pose, *discs, (v.x, v.y)))
        except ValueError as error:
            refused.append(Refusal('shape', f'object {item.id} of type {kind}: {error}'))
    return Obstacles(stamp_ns, tuple(items), tuple(refused)), Predictions(stamp_ns, {})
