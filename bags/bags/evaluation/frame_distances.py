"""The distance to an obstacle in Cartesian and in Frenet coordinates. Numpy only, metres.

The paper's first experiment (section "Cartesian vs Frenet Reference Frame"): on a circular path the
distance of a vehicle to an obstacle is sqrt(ds^2 + de^2) - radii in Frenet coordinates, as in the
baseline, and the chord less the radii in Cartesian coordinates. Closed forms of plane trigonometry;
no code is shared with the controllers.
"""

from typing import Any, NamedTuple

import numpy as np

from bags.errors import BagError
from bags.evaluation.drive import Drive
from bags.evaluation.series import circle_centres

ROUNDNESS = 1e-3  # relative deviation of a reference's radius below which it is a circle
EARLY_LAPS = 0.01  # laps before the start of the path that still count as its start
GAPS_M = (2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0)  # along the path, those of the table
WIDER = (1.0, 2.0, 5.0, 10.0)  # radii of the table, in those of the circle
CLOSE = 1e-4  # relative; a gap next to the obstacle, and squared the precision of a bisection


class Circle(NamedTuple):
    """A path of constant curvature and one obstacle beside it."""

    centre: np.ndarray  # (2,) m, map
    radius: float  # m, of the path
    turn: float  # 1 when the path turns left, -1 when it turns right
    station: float  # m along the path, of the obstacle
    inside: float  # m from the path towards its centre, of the obstacle's centre
    reach: float  # m, radii of obstacle and vehicle together

    @property
    def sides(self) -> dict[str, float]:
        """How far inside the path an obstacle on either side of it is [m]."""
        return {'inside': abs(self.inside), 'outside': -abs(self.inside)}

    @property
    def own_side(self) -> str:
        """The side of the obstacle."""
        return 'inside' if self.inside > 0 else 'outside'


class Distances(NamedTuple):
    """D_V2O [m] of the same situations, measured in two ways."""

    frenet: np.ndarray
    cartesian: np.ndarray

    @property
    def overestimation(self):
        """By how much Frenet coordinates overestimate the distance [m]."""
        return self.frenet - self.cartesian


class DrivenDistances(NamedTuple):
    """A drive in path coordinates; every array has one entry per odometry message."""

    station: np.ndarray  # m along the path
    inside: np.ndarray  # m from the path towards its centre
    distances: dict[str, Distances]  # by side: to the obstacle, and to one mirrored at the path


def circle_distances(radius, gap, inside, reach, vehicle=0.0) -> Distances:
    """Return the distances on a circular path by closed form; arrays are broadcast.

    gap      m along the path between vehicle and obstacle
    inside   m from the path towards its centre, of the obstacle; negative outside
    reach    m, both radii
    vehicle  m from the path towards its centre, of the vehicle
    """
    near, far = radius - inside, radius - vehicle
    # the law of cosines, written so that it is exact for small angles too
    chord = np.sqrt((near - far) ** 2 + 4 * near * far * np.sin(gap / radius / 2) ** 2)
    return Distances(np.hypot(gap, inside - vehicle) - reach, chord - reach)


def find_circle(drive) -> Circle:
    """Return the circle of a drive; BagError without a circular path and one resting obstacle."""
    path, obstacles = drive.scene.reference, drive.scene.obstacles
    if len(obstacles) != 1:
        raise BagError(f'one obstacle is needed to compare distances; there are {len(obstacles)}')
    # the circles through every three neighbouring points
    a, b, c = path[:-2], path[1:-1], path[2:]
    into, out, chord = (b - a).T, (c - b).T, (c - a).T
    twice_area = into[0] * out[1] - into[1] * out[0]
    curvature = 2 * twice_area / (np.hypot(*into) * np.hypot(*out) * np.hypot(*chord))
    mean = float(np.mean(curvature))
    if mean == 0 or np.ptp(curvature) > ROUNDNESS * abs(mean):
        raise BagError('the coarse path is no circle; distances compare on circle_20m')
    normal = np.array([-chord[1], chord[0]]) / np.hypot(*chord)
    centre, turn = np.mean(b.T + normal / mean, axis=1), float(np.sign(mean))
    reach = obstacles[0].radius + drive.facts.vehicle_radius
    seen = Circle(centre, 1 / abs(mean), turn, 0.0, 0.0, reach)
    station, inside = _coordinates(_position_at_rest(obstacles[0])[None, :], path, seen)
    return seen._replace(station=float(station[0]), inside=float(inside[0]))


def _coordinates(points, path, circle):
    """Return the station along the circle and the distance inside of it [m] of points (m, 2).

    The points are in driving order, the first of them on the first lap of the path.
    """
    away, start = points - circle.centre, path[0] - circle.centre
    bearing = np.unwrap(np.arctan2(away[:, 1], away[:, 0])) - np.arctan2(start[1], start[0])
    laps = circle.turn * bearing / (2 * np.pi)
    laps -= np.floor(laps[0] + EARLY_LAPS)
    return 2 * np.pi * circle.radius * laps, circle.radius - np.hypot(*away.T)


def _position_at_rest(obstacle):
    places = np.column_stack([obstacle.x, obstacle.y])
    places = places[np.all(np.isfinite(places), axis=1)]
    if np.any(np.ptp(places, axis=0) > 0):
        raise BagError('the obstacle moves; distances compare at one that rests')
    return places[0]


def driven_distances(drive, circle: Circle) -> DrivenDistances:
    """Return the distances at the recorded poses of a drive, first circle of the vehicle."""
    motion, path = drive.motion, drive.scene.reference
    (points,) = circle_centres(motion, drive.facts.circles[:1])
    station, inside = _coordinates(points, path, circle)
    place = _position_at_rest(drive.scene.obstacles[0])
    outwards = (place - circle.centre) / np.hypot(*(place - circle.centre))
    gap, distances = station - circle.station, {}
    for side, offset in circle.sides.items():
        # at the same station
        spot = place + (circle.inside - offset) * outwards
        distances[side] = Distances(
            np.hypot(gap, inside - offset) - circle.reach,
            np.hypot(*(points - spot).T) - circle.reach,
        )
    return DrivenDistances(station, inside, distances)


def distance_numbers(drive: Drive, circle: Circle, driven: DrivenDistances) -> dict[str, Any]:
    """Return all numbers of the figure, in metres: the contents of distances.json.

    Those of the recorded poses hold where the drive came that close.
    """

    def closed(radius):
        forms = {
            side: circle_distances(radius, np.array(GAPS_M), inside, circle.reach)
            for side, inside in circle.sides.items()
        }
        return {side: distances.overestimation.tolist() for side, distances in forms.items()}

    own, gap = driven.distances[circle.own_side], driven.station - circle.station
    coming, table, deviation = gap <= 0.0, {}, 0.0
    for side, distances in driven.distances.items():
        curve = distances.overestimation[coming][::-1]
        table[side] = np.interp(GAPS_M, -gap[coming][::-1], curve).tolist()
        form = circle_distances(circle.radius, gap, circle.sides[side], circle.reach, driven.inside)
        deviation = max(deviation, float(np.abs(np.subtract(distances, form)).max()))
    return {
        'scenario': drive.facts.scenario,
        'controller': drive.facts.controller,
        'radius_m': circle.radius,
        'obstacle_at_m': circle.station,
        'obstacle_inside_m': circle.inside,
        'radii_together_m': circle.reach,
        'gaps_m': list(GAPS_M),
        'overestimation_m': closed(circle.radius),
        'outside_turns_at_m': turning_gap(circle.radius, circle.sides['outside']),
        'over_curvature': [
            {'curvature_1pm': 1 / radius, **closed(radius)}
            for radius in (factor * circle.radius for factor in WIDER)
        ],
        'recorded': {
            'min_v2o_m': float(own.cartesian.min()),
            'min_v2o_frenet_m': float(own.frenet.min()),
            'collided': bool(own.cartesian.min() < 0),
            'largest_offset_from_path_m': float(np.abs(driven.inside).max()),
            'largest_deviation_from_closed_form_m': deviation,
            'overestimation_m': table,
        },
    }


def turning_gap(radius: float, inside: float) -> float:
    """Return the gap [m] up to which Frenet coordinates underestimate the distance to an obstacle.

    0 for one inside the circle: there they overestimate it at every gap.
    """

    def over(gap):
        return circle_distances(radius, gap, inside, 0.0).overestimation

    low, high = 0.0, np.pi * radius
    if over(high * CLOSE) >= 0:
        return 0.0
    while high - low > high * CLOSE**2:
        middle = (low + high) / 2
        low, high = (low, middle) if over(middle) > 0 else (middle, high)
    return float(high)
