"""What families share: trials of a draw, and the parts of a document: roads, what is on them.

Metres, seconds, m/s; a document holds what yaml.safe_load would return for a scenario file.
"""

from collections.abc import Mapping, Sequence
from random import Random
from typing import Any

SCHEMA = 1
LANE = 3.5  # m
# a lane each way and shoulders of 0.75 m; y = 0 is the middle of the own lane
LEFT, RIGHT = 6.0, -2.5
BEFORE = 20.0  # m of road behind the start, and beyond the end of the path
PREVIEW_S = 2.7  # of path beyond the finish: more than a horizon of 2.5 s
AFTER_S = 3.0  # of driving beyond the last obstacle: a car that is lost afterwards is lost
TIME_FACTOR = 2.2  # of the time limit over the time at the desired speed
SPARE_S = 6.0  # of the time limit
DIGITS = 4  # 0.1 mm; of a curvature 0.3 % in a bend of 30 m
CAR_RADIUS = 1.05  # m, of the discs of a car
# m, places along it, the front first, which shows soonest where it turns: together 4.8 m long
CAR_DISCS = (1.35, -1.35)
FRICTION = 1.0  # of roads that say nothing else, where the draw is nominal

Document = dict[str, Any]
Block = dict[str, Any]


class ImpossibleError(Exception):
    """A trial that no car can master: the draw is drawn again."""


class Trial(Random):
    """The random numbers of a draw; a hard one is not tested for whether it can be mastered."""

    hard = False

    def among(self, nominal: tuple[float, float], hard: tuple[float, float]) -> float:
        """Return a number between the ends for the difficulty of the draw."""
        return self.uniform(*(hard if self.hard else nominal))

    def require(self, can_be_mastered: bool) -> None:
        """Raise ImpossibleError for a nominal draw that cannot be mastered."""
        if not (self.hard or can_be_mastered):
            raise ImpossibleError


def finish(x: float, speed: float) -> float:
    """Return the station [m] of the finish for a last obstacle at a station."""
    return x + max(25.0, AFTER_S * speed)


def document(
    description: str,
    length: float,
    speed: float,
    obstacles: Sequence[Block],
    *,
    friction: float = FRICTION,
    segments: Sequence[Block] | None = None,
    path_segments: Sequence[Block] | None = None,
    left: Any = LEFT,
    right: Any = RIGHT,
    patches: Sequence[Block] = (),
    extra_s: float = 0.0,
) -> Document:
    """Return a scenario document whose finish is at station `length` of the path.

    Without `segments` road and path are straight and begin at x = -BEFORE and x = 0; stations of
    obstacles, edges and patches count from the start of the path. `segments` are those of both from
    the start of the path to `length`; `path_segments` those of the path where it has its own.
    `left` and `right` are offsets [m] or (stations, offsets).
    """
    preview = PREVIEW_S * speed + 5.0
    pieces = [straight(length)] if segments is None else list(segments)
    own = pieces if path_segments is None else list(path_segments)
    time = TIME_FACTOR * (length + preview) / speed + SPARE_S + extra_s
    parts = {
        'schema': SCHEMA,
        'name': 'draw',
        'description': description,
        'road': {
            'centre_line': {
                'start': pose(-BEFORE),
                'segments': [straight(BEFORE), *pieces, straight(preview + BEFORE)],
            },
            'edges': {'left': _edge(left), 'right': _edge(right)},
        },
        'path': {'start': pose(0.0), 'segments': [*own, straight(preview)]},
        'speed': {'constant_mps': speed},
        'friction': friction,
        'start': {'progress_m': 0.0},
        'stop': {'progress_m': length, 'time_s': time},
        'obstacles': [_shifted(block) for block in obstacles],
    }
    if patches:
        parts['friction_patches'] = [
            {**patch, 'from_m': patch['from_m'] + BEFORE, 'to_m': patch['to_m'] + BEFORE}
            for patch in patches
        ]
    return rounded(parts)


def _edge(offset):
    if isinstance(offset, float):
        return {'offset_m': offset}
    stations, offsets = offset
    return {'stations_m': [s + BEFORE for s in stations], 'offsets_m': list(offsets)}


def _shifted(block):
    if 'waypoints' in block:
        points = block['waypoints']
        moved = [{**point, 'station_m': point['station_m'] + BEFORE} for point in points]
        return {**block, 'waypoints': moved}
    return {**block, 'station_m': block['station_m'] + BEFORE}


def pose(x: float) -> Block:
    """Return a pose on the x axis, along it."""
    return {'x_m': x, 'y_m': 0.0, 'yaw_rad': 0.0}


def straight(length: float) -> Block:
    """Return a straight."""
    return {'straight': {'length_m': length}}


def arc(length: float, curvature: float) -> Block:
    """Return an arc of a curvature [1/m]."""
    return {'arc': {'length_m': length, 'curvature_1pm': curvature}}


def clothoid(length: float, begin: float, end: float) -> Block:
    """Return a clothoid between two curvatures [1/m]."""
    ends = {'start_curvature_1pm': begin, 'end_curvature_1pm': end}
    return {'clothoid': {'length_m': length, **ends}}


def lane_change(length: float, offset: float) -> Block:
    """Return a lane change of a length straight ahead."""
    return {'lane_change': {'length_m': length, 'offset_m': offset}}


def disc(station: float, offset: float, radius: float, **motion: Any) -> Block:
    """Return an obstacle on the road, one disc; `motion` are further keys of the schema."""
    return {'station_m': station, 'offset_m': offset, 'radius_m': radius, **motion}


def car(station: float, offset: float, speed: float = 0.0, **motion: Any) -> Block:
    """Return a car along the road, at a speed of either sign."""
    return disc(station, offset, CAR_RADIUS, along_mps=speed, discs_m=CAR_DISCS, **motion)


def waypoint(station: float, offset: float, speed: float, wait: float = 0.0) -> Block:
    """Return a way-point."""
    point = {'station_m': station, 'offset_m': offset, 'speed_mps': speed}
    return {**point, 'wait_s': wait} if wait else point


def car_along(points: Sequence[Block], **times: float) -> Block:
    """Return a car that follows way-points."""
    return {'waypoints': [*points], 'radius_m': CAR_RADIUS, 'discs_m': CAR_DISCS, **times}


def rounded(value: Any) -> Any:
    """Return a document whose numbers have DIGITS decimals."""
    if isinstance(value, Mapping):
        return {key: rounded(member) for key, member in value.items()}
    if isinstance(value, (list, tuple)):
        return [rounded(member) for member in value]
    return round(value, DIGITS) if isinstance(value, float) else value


def mirrored(value: Any, key: str = '') -> Any:
    """Return a document with left and right exchanged."""
    if isinstance(value, Mapping):
        members = {name: mirrored(member, name) for name, member in value.items()}
        if {'left', 'right'} <= members.keys():
            members |= {'left': members['right'], 'right': members['left']}
        if 'from_offset_m' in members:
            low, high = members['from_offset_m'], members['to_offset_m']
            members |= {'from_offset_m': high, 'to_offset_m': low}
        return members
    if isinstance(value, list):
        return [mirrored(member, key) for member in value]
    is_lateral = key in MIRRORED and isinstance(value, float)
    return -value if is_lateral and value else value


MIRRORED = frozenset(
    {
        *('offset_m', 'offsets_m', 'across_mps', 'from_offset_m', 'to_offset_m'),
        *('curvature_1pm', 'start_curvature_1pm', 'end_curvature_1pm', 'y_m', 'yaw_rad'),
    }
)


def either_side(random: Random, parts: Document) -> Document:
    """Return a document or its mirror image, with equal chances."""
    return mirrored(parts) if random.random() < 0.5 else parts


def emergency(
    random: Random,
    description: str,
    last: float,
    speed: float,
    obstacles: Sequence[Block],
    **parts: Any,
) -> Document:
    """Return the `document` of these parts or its mirror image, with equal chances.

    The run finishes AFTER_S beyond the obstacle at the station `last` [m].
    """
    parts = document(description, finish(last, speed), speed, obstacles, **parts)
    return either_side(random, parts)
