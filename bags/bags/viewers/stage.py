"""From the values of the topics to what a 3D viewer is shown: the latest of each, drawn in time."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from bags.viewers import shapes
from bags.viewers.shapes import Shape, ShapeParams

VEHICLE, SAFETY, PREDICTION = '/markers/vehicle', '/markers/safety', '/markers/prediction'
STATE, PLAN = '/vehicle/odometry', '/controller/prediction'
REFERENCE, EDGES = '/scenario/reference', '/scenario/road_edges'
OBSTACLES, WHY = '/scenario/obstacles', '/controller/why'
WATCHED = (STATE, PLAN, REFERENCE, EDGES, OBSTACLES, WHY)
PERIOD_NS = 50_000_000  # that of the controller


class Picture(NamedTuple):
    """What a marker topic shows from a stamp on."""

    topic: str
    stamp_ns: int
    shapes: Sequence[Shape]


class Stage:
    """Keeps the latest value of each topic of WATCHED."""

    def __init__(self, params: ShapeParams):
        self.params = params
        self._latest: dict[str, Any] = {}
        self._due_ns = 0

    def wants(self, topic: str, stamp_ns: int) -> bool:
        """Whether a message is worth decoding: of a thousand states a second 20 are drawn."""
        # a clock that went back is a run that began anew
        early = self._due_ns - PERIOD_NS <= stamp_ns < self._due_ns
        return topic != STATE or not early

    def take(self, topic: str, value: Any) -> list[Picture]:
        """Note a value of `msgs_yaml.types`; return what is to be drawn because of it."""
        self._latest[topic] = value
        if topic == PLAN:
            drawn = shapes.prediction(value, self._latest.get(REFERENCE))
            return [Picture(PREDICTION, value.stamp_ns, drawn)]
        if topic != STATE:
            return []
        self._due_ns = value.stamp_ns + PERIOD_NS
        why, seen = self._latest.get(WHY), self._latest.get(OBSTACLES)
        use = shapes.friction_use(why.values) if why else {}
        obstacles, edges = seen.items if seen else (), self._latest.get(EDGES)
        car = shapes.vehicle(value, use, self.params.outline)
        areas = shapes.safety(value, obstacles, edges, self.params.safety)
        return [Picture(VEHICLE, value.stamp_ns, car), Picture(SAFETY, value.stamp_ns, areas)]
