"""The car, its safety areas and its plan as plain shapes in the frame map: SI units, z up.

`MarkerScene` keeps the latest value of each topic and returns the shapes to draw. Shapes are
independent of ROS: markers_node turns them into messages.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np

from bags.evaluation import geometry
from bags.evaluation.controller_log import CandidateLine, candidate_lines, report_number
from bags.figures import scene, style
from msgs_yaml.types import Obstacle, Prediction, Reference, RoadEdges, VehicleState
from node_runtime.parameters import Range, Struct

BOX, DISC, LINE, TEXT = 'box', 'disc', 'line', 'text'
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


class Shape(NamedTuple):
    """One shape; ns and id identify it from message to message."""

    ns: str
    id: int
    kind: str
    colour: tuple[float, float, float, float]  # red, green, blue, opacity: 0 to 1
    # m; of a line its width, of a text its height, comes first
    size: tuple[float, float, float] = (LINE_M, 0.0, 0.0)
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, centre
    yaw: float = 0.0  # rad
    points: np.ndarray = np.empty((0, 2))  # m, of a line, in map
    colours: np.ndarray = np.empty((0, 4))  # of its points; none where `colour` is that of all
    text: str = ''


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
) -> list[Shape]:
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
        Shape('body', 0, BOX, GREY, size, middle, state.psi),
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
            shapes.append(Shape('friction', k, BOX, look, size, ahead(place, bar), state.psi))
            text = Shape('use', k, TEXT, look, (LETTER_M,) * 3, ahead(place, above))
            shapes.append(text._replace(text=f'{axle} {use:.2f}'))
    return shapes


def safety_shapes(
    state: VehicleState,
    obstacles: Sequence[Obstacle],
    edges: RoadEdges | None,
    distances: SafetyParams,
) -> list[Shape]:
    """Return the circles of the car, each obstacle with its unsafe area, each edge with its strip.

    As in the figures: the centre of a car's circle must stay out of the areas that are shown.
    """
    own = distances.circle_radius_m
    pose, nothing = (state.X, state.Y, state.psi), geometry.Outline(0.0, 0.0, 0.0)
    seen = scene.car_shapes(*pose, nothing, distances.circle_offsets_m, own)
    for item in obstacles:
        centre = item.X, item.Y
        seen += scene.obstacle_shapes(item.id, centre, item.r_obs, own, distances.obstacle_m)
    if edges is not None:
        seen += scene.road_shapes(edges.left, edges.right, own + distances.edge_m)
    shapes = []
    for shape in seen:
        if shape.kind in DISCS:
            ns, colour, height = DISCS[shape.kind]
            at, wide = (*shape.points.tolist(), height / 2), 2.0 * shape.radius
            look, size = _rgba(colour, 0.3), (wide, wide, height)
            shapes.append(Shape(ns, shape.number, DISC, look, size, at))
        elif shape.kind in LINES:
            shapes.append(_line(shape.kind, shape.number, shape.points, _rgba(LINES[shape.kind])))
    return shapes


def prediction_shapes(
    plan: Prediction, reference: Reference | None, candidates: Sequence[CandidateLine] = ()
) -> list[Shape]:
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
        shapes.append(horizon._replace(colours=colours))
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
    return Shape(ns, number, LINE, colour, points=points)


VEHICLE, SAFETY, PREDICTION = '/markers/vehicle', '/markers/safety', '/markers/prediction'
STATE, PLAN = '/vehicle/odometry', '/controller/prediction'
REFERENCE, EDGES = '/scenario/reference', '/scenario/road_edges'
OBSTACLES, WHY = '/scenario/obstacles', '/controller/why'
WATCHED = (STATE, PLAN, REFERENCE, EDGES, OBSTACLES, WHY)
PERIOD_NS = 50_000_000  # that of the controller
MAX_POINTS = 5000  # of a drawn line, as topics.yaml allows


class Drawing(NamedTuple):
    """The shapes that a marker topic shows from a stamp on."""

    topic: str
    stamp_ns: int
    shapes: Sequence[Shape]


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

    def update(self, topic: str, value: Any) -> list[Drawing]:
        """Store a value of `msgs_yaml.types`; return what it changes in the scene."""
        self._latest[topic] = value
        plan = self._latest.get(PLAN)
        if topic in (PLAN, WHY):
            lines = candidate_lines(value.values) if topic == WHY else []
            # a report draws the plan of its tick again, with those that were not chosen
            if topic == WHY and not (lines and plan and plan.stamp_ns == value.stamp_ns):
                return []
            drawn = prediction_shapes(plan, self._latest.get(REFERENCE), lines)
            return [Drawing(PREDICTION, value.stamp_ns, drawn)]
        if topic != STATE:
            return []
        self._due_ns = value.stamp_ns + PERIOD_NS
        why, message = self._latest.get(WHY), self._latest.get(OBSTACLES)
        obstacles, edges = message.items if message else (), self._latest.get(EDGES)
        car = vehicle_shapes(value, why.values if why else {}, self.params.outline)
        areas = safety_shapes(value, obstacles, edges, self.params.safety)
        return [Drawing(VEHICLE, value.stamp_ns, car), Drawing(SAFETY, value.stamp_ns, areas)]
