"""Publishes markers for RViz and Foxglove: car, circles, unsafe areas, plan.

Topics and tf are in its namespace: the frames of every car have the same names. Its subscriptions
are best effort with a queue of one, so that it never slows a publisher. Where no plant publishes
/tf, as while a bag is played, it does; that needs tf2_msgs. Markers are in the frame map, in SI
units, z up.
"""

import sys
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Annotated, Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from rclpy.node import Node
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from bags.evaluation import geometry
from bags.evaluation.drive import CandidateLine, candidate_lines, report_number
from bags.figures import scene, style
from bags.storage.columns import DECODERS
from msgs_yaml import contract, conversions, decode, encode, share
from msgs_yaml.types import Obstacle, Prediction, Reference, RoadEdges, VehicleState
from node_runtime import ros, spin_node, subscriptions_node
from node_runtime.parameters import Range, Struct

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # there is no wheel of it
    TFMessage = None

VEHICLE, SAFETY, PREDICTION = '/markers/vehicle', '/markers/safety', '/markers/prediction'
STATE, PLAN = '/vehicle/odometry', '/controller/prediction'
REFERENCE, EDGES = '/scenario/reference', '/scenario/road_edges'
OBSTACLES, WHY = '/scenario/obstacles', '/controller/why'
WATCHED = (STATE, PLAN, REFERENCE, EDGES, OBSTACLES, WHY)
PERIOD_NS = 50_000_000  # that of the controller
MAX_POINTS = 5000  # of a drawn line, as topics.yaml allows
READERS = {  # of serialised messages of any size
    REFERENCE: subscriptions_node.read_reference,
    EDGES: subscriptions_node.read_road_edges,
    OBSTACLES: subscriptions_node.read_obstacles,
}
THROTTLE_S = 1.0
TF = '/tf'
AXLES = ('front', 'rear')
CAR_HEIGHT_M = 1.4
FLAT_M = 0.02
LINE_M = 0.12
BAR_M = (0.3, 0.5, 2.0)  # length, width, and height at the limit that the controller believes in
LETTER_M = 0.8
GREY = (0.35, 0.4, 0.45, 0.75)
GREEN, RED = np.array([0.1, 0.65, 0.3]), np.array([0.8, 0.15, 0.1])
SLOW, FAST = np.array([0.85, 0.25, 0.1]), np.array([0.1, 0.45, 0.85])
SPEED_SPAN_MPS = 5.0  # range of speeds that the colours cover
# by kind of a shape: namespace, colour, and height [m] of the disc; colour of the line
DISCS = {
    'circle': ('circle', style.KNOWN['mpcc'], 2 * FLAT_M),
    'touch': ('collision', style.COLLISION, 2 * FLAT_M),
    'unsafe': ('unsafe', style.UNSAFE, FLAT_M),
}
LINES = {'edge': style.EDGE, 'limit': style.UNSAFE}

Overhang = Annotated[float, Range(0.5, 10.0, 'm')]
Distance = Annotated[float, Range(0.0, 10.0, 'm')]


class OutlineParams(Struct):
    """The car's outline, seen from its centre of gravity."""

    front_m: Overhang
    rear_m: Overhang
    width_m: Annotated[float, Range(0.5, 5.0, 'm')]


class SafetyParams(Struct):
    """The circles of the car, and the distances it has to keep."""

    circle_offsets_m: Annotated[tuple[float, ...], Range(-10.0, 10.0, 'm')]
    circle_radius_m: Annotated[float, Range(0.1, 5.0, 'm')]
    obstacle_m: Distance
    edge_m: Distance


class ShapeParams(Struct):
    """The parameters of a run that its topics do not carry."""

    outline: OutlineParams
    safety: SafetyParams


def vehicle_shapes(
    state: VehicleState, why: Mapping[str, float | str], outline: OutlineParams
) -> list[Marker]:
    """Return the car with its true outline, and a bar of the friction use F / (mu F_z) per axle.

    `why` are the values of /controller/why; an axle of which they have no finite use has no bar.
    """
    pose = state.X, state.Y, state.psi
    edge = geometry.Outline(outline.front_m, outline.rear_m, outline.width_m)
    corners = scene.car_shapes(*pose, edge)[0].points
    size = (outline.front_m + outline.rear_m, outline.width_m, CAR_HEIGHT_M)

    def ahead(distance, height):
        return *geometry.transform_to_map((distance, 0.0), *pose).tolist(), height

    middle = ahead((outline.front_m - outline.rear_m) / 2, CAR_HEIGHT_M / 2)
    shapes = [
        _marker('body', 0, Marker.CUBE, GREY, size, middle, state.psi),
        _line('outline', 0, np.concatenate([corners, corners[:1]]), _rgba(style.KNOWN['mpcc'])),
    ]
    length, width, full = BAR_M
    for k, (axle, place) in enumerate(zip(AXLES, (outline.front_m / 2, -outline.rear_m / 2))):
        use = report_number(why, f'friction.{axle}')
        if np.isfinite(use):
            use = min(max(use, 0.0), 1.0)
            height = max(use * full, FLAT_M)
            look = (*_mix(GREEN, RED, use).tolist(), 0.95)
            bar, above = (CAR_HEIGHT_M + h for h in (height / 2, height + LETTER_M))
            size = (length, width, height)
            at = ahead(place, bar)
            shapes.append(_marker('friction', k, Marker.CUBE, look, size, at, state.psi))
            text, at = f'{axle} {use:.2f}', ahead(place, above)
            kind, height = Marker.TEXT_VIEW_FACING, (0.0, 0.0, LETTER_M)
            shapes.append(_marker('use', k, kind, look, height, at, text=text))
    return shapes


def safety_shapes(
    state: VehicleState,
    obstacles: Sequence[Obstacle],
    edges: RoadEdges | None,
    distances: SafetyParams,
) -> list[Marker]:
    """Return the circles of the car, each obstacle with its unsafe area, each edge with its strip.

    As in the figures: the centre of a car's circle must stay out of the areas that are shown.
    """
    own = distances.circle_radius_m
    pose, nothing = (state.X, state.Y, state.psi), geometry.Outline(0.0, 0.0, 0.0)
    seen = scene.car_shapes(*pose, nothing, distances.circle_offsets_m, own)
    for item in obstacles:
        for k, o in enumerate(item.discs()):
            safe = distances.obstacle_m
            seen += scene.obstacle_shapes(item.id, (o.X, o.Y), item.r_obs, own, safe, k)
    if edges is not None:
        seen += scene.road_shapes(edges.left, edges.right, own + distances.edge_m)
    shapes = []
    for shape in seen:
        if shape.kind in DISCS:
            ns, colour, height = DISCS[shape.kind]
            at, wide = (*shape.points.tolist(), height / 2), 2.0 * shape.radius
            look, size = _rgba(colour, 0.3), (wide, wide, height)
            shapes.append(_marker(ns, shape.number, Marker.CYLINDER, look, size, at))
        elif shape.kind in LINES:
            shapes.append(_line(shape.kind, shape.number, shape.points, _rgba(LINES[shape.kind])))
    return shapes


def prediction_shapes(
    plan: Prediction, reference: Reference | None, candidates: Sequence[CandidateLine] = ()
) -> list[Marker]:
    """Return the horizon, coloured by its speed, the coarse path, and the plans not chosen."""
    points = np.column_stack([plan.X, plan.Y])
    shapes = []
    if len(points) > 1:
        speed = np.hypot(*np.diff(points, axis=0).T) / np.diff(plan.t)
        speed = np.append(speed, speed[-1])
        # FAST is the largest speed of the plan, SLOW is SPEED_SPAN_MPS below it
        share = np.clip(1.0 - (speed.max() - speed) / SPEED_SPAN_MPS, 0.0, 1.0)
        colours = np.column_stack([_mix(SLOW, FAST, share[:, None]), np.ones(len(speed))])
        horizon = _line('horizon', 0, points, _rgba(style.KNOWN['mpcc']))
        horizon.colors = list(map(_colour, colours))
        shapes.append(horizon)
    if reference is not None:
        path = np.column_stack([reference.X, reference.Y])
        shapes.append(_line('reference', 0, path, _rgba(style.REFERENCE)))
    for line in candidates:
        if not line.is_chosen and len(line.points) > 1:
            colour = _rgba(style.REFERENCE if line.is_clean else style.COLLISION, 0.6)
            shapes.append(_line('candidate', line.number, line.points, colour))
    return shapes


def _mix(colour, other, share):
    return colour + share * (other - colour)


def _rgba(hex_colour: str, opacity=1.0):
    return *(part / 255 for part in bytes.fromhex(hex_colour.lstrip('#'))), opacity


def _line(ns, number, points, colour):
    """Return a line through MAX_POINTS of its points at most: markers are built point by point."""
    if len(points) > MAX_POINTS:
        points = points[np.linspace(0, len(points) - 1, MAX_POINTS).round().astype(int)]
    line = _marker(ns, number, Marker.LINE_STRIP, colour, (LINE_M, 0.0, 0.0))
    line.points = [Point(x=float(X), y=float(Y)) for X, Y in points]
    return line


def _marker(ns, number, kind, colour, size, at=(0.0, 0.0, 0.0), yaw=0.0, text=''):
    """Return a marker without its header; ns and id identify it from message to message."""
    marker = Marker(ns=ns, id=number, type=kind, action=Marker.ADD, text=text)
    position, orientation = marker.pose.position, marker.pose.orientation
    position.x, position.y, position.z = at
    orientation.z, orientation.w = conversions.heading_to_quaternion(yaw)
    marker.scale.x, marker.scale.y, marker.scale.z = size
    marker.color = _colour(colour)
    return marker


def _colour(rgba):
    red, green, blue, opacity = (float(value) for value in rgba)
    return ColorRGBA(r=red, g=green, b=blue, a=opacity)


def marker_array(topic: str, stamp_ns: int, markers: Sequence[Marker]) -> MarkerArray:
    """Return the message of a marker topic; it replaces all markers sent before."""
    sec, nanosec = conversions.split_stamp(stamp_ns)
    frame = contract.load().topics[topic].frame
    header = Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=frame)
    for marker in markers:
        marker.header = header
    return MarkerArray(markers=[Marker(header=header, action=Marker.DELETEALL), *markers])


class MarkerScene:
    """Keeps the latest value of each topic of WATCHED."""

    def __init__(self, params: ShapeParams):
        self.params = params
        self._latest: dict[str, Any] = {}
        self._due_ns = 0

    def needs(self, topic: str, stamp_ns: int) -> bool:
        """Return whether a message is to be decoded: of 1000 states per second 20 are drawn."""
        # a clock that went back belongs to a new run
        early = self._due_ns - PERIOD_NS <= stamp_ns < self._due_ns
        return topic != STATE or not early

    def update(self, topic: str, value: Any) -> dict[str, MarkerArray]:
        """Store a value of `msgs_yaml.types`; return the message of each topic that it changes."""
        self._latest[topic] = value
        plan, why = self._latest.get(PLAN), self._latest.get(WHY)
        drawn = {}
        if topic == PLAN:
            drawn[PREDICTION] = prediction_shapes(plan, self._latest.get(REFERENCE))
        elif topic == WHY:
            lines = candidate_lines(value.values)
            # a report draws the plan of its tick again, with those that were not chosen
            if lines and plan and plan.stamp_ns == value.stamp_ns:
                drawn[PREDICTION] = prediction_shapes(plan, self._latest.get(REFERENCE), lines)
        elif topic == STATE:
            self._due_ns = value.stamp_ns + PERIOD_NS
            message, edges = self._latest.get(OBSTACLES), self._latest.get(EDGES)
            obstacles, report = message.items if message else (), why.values if why else {}
            drawn[VEHICLE] = vehicle_shapes(value, report, self.params.outline)
            drawn[SAFETY] = safety_shapes(value, obstacles, edges, self.params.safety)
        return {name: marker_array(name, value.stamp_ns, shapes) for name, shapes in drawn.items()}


class MarkersNode(Node):
    """Publishes markers of each plan, and of the car 20 times per second of ROS time."""

    def __init__(self):
        super().__init__('markers')
        defaults = share.path('bags', 'config', 'markers.yaml')
        self.scene = MarkerScene(ros.declare(self, ShapeParams, defaults))
        self.pubs = {t: ros.publisher(self, t) for t in (VEHICLE, SAFETY, PREDICTION)}
        self.tf = ros.publisher(self, TF) if TFMessage else None
        if self.tf is None:
            self.get_logger().info('tf2_msgs is not installed: no /tf; markers are in map anyway')
        for topic in WATCHED:
            profile = ros.observer_profile(contract.load().topics[topic], ros.mode(self))
            callback, kind = partial(self.on_message, topic), ros.message_type(topic)
            self.create_subscription(kind, ros.relative_name(topic), callback, profile, raw=True)

    def on_message(self, topic, raw):
        """Publish what a message changes; nothing for one that breaks the contract."""
        try:
            stamp_ns = decode.stamp_ns_of(raw) if topic == STATE else 0
            if not self.scene.needs(topic, stamp_ns):
                return
            if topic in READERS:
                value = READERS[topic](raw)
            else:
                value = DECODERS[topic](ros.deserialize(topic, raw))
        except decode.DecodeError as error:
            text = f'nothing is drawn of this: {error}'
            self.get_logger().warning(text, throttle_duration_sec=THROTTLE_S)
            return
        for drawn, message in self.scene.update(topic, value).items():
            self.pubs[drawn].publish(message)
        # no other node publishes it: a frame must have one publisher
        if topic == STATE and self.tf and self.count_publishers(ros.full_name(self, TF)) <= 1:
            self.tf.publish(TFMessage(transforms=[encode.transform(value)]))


def main() -> int:
    """Publish until SIGINT or SIGTERM."""
    about = 'Publish road, obstacles, car and plan of a run as markers, for RViz and Foxglove.'
    return spin_node.run(MarkersNode, about, '--ros-args -p mode:=realtime')


if __name__ == '__main__':
    sys.exit(main())
