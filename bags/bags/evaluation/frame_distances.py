"""One distance in two frames: on the ground, and in coordinates along a path. Numpy only, metres.

The paper's first experiment (section "Cartesian vs Frenet Reference Frame"): on a circular path the
distance of a vehicle to an obstacle is sqrt(ds^2 + de^2) - radii in path coordinates, as the
baseline takes it, and the chord less the radii on the ground. The closed forms are those of plane
trigonometry; nothing here is shared with the controllers.
"""

from typing import NamedTuple

import numpy as np

from bags.errors import BagError

ROUNDNESS = 1e-3  # relative deviation of a reference's radius below which it is a circle
EARLY_LAPS = 0.01  # laps before the start of the path that still count as such


class Circle(NamedTuple):
    """A path of constant curvature and one obstacle beside it."""

    centre: np.ndarray  # (2,) m, map
    radius: float  # m, of the path
    turn: float  # 1 when the path turns left, -1 when it turns right
    station: float  # m along the path, of the obstacle
    inside: float  # m from the path towards its centre, of the obstacle's centre
    reach: float  # m, radii of obstacle and vehicle together


class Distances(NamedTuple):
    """D_V2O [m] of the same situations, measured in two ways."""

    frenet: np.ndarray
    cartesian: np.ndarray

    @property
    def overestimation(self):
        """By how much path coordinates see more room than there is [m]."""
        return self.frenet - self.cartesian


class DrivenDistances(NamedTuple):
    """A drive seen from the path; every array has one entry per odometry message."""

    station: np.ndarray  # m along the path
    inside: np.ndarray  # m from the path towards its centre
    distances: Distances  # to the obstacle where it stands
    beyond: Distances  # to one imagined as far outside the path


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
    """Return the circle of a drive; BagError when path or obstacle are not of that kind."""
    path, obstacles = drive.scene.reference, drive.scene.obstacles
    if len(obstacles) != 1:
        raise BagError(f'one obstacle is needed to compare distances; there are {len(obstacles)}')
    centre, radius, turn = _fitted(path)
    seen = Circle(centre, radius, turn, 0.0, 0.0, obstacles[0].radius + drive.facts.vehicle_radius)
    station, inside = _coordinates(_position_at_rest(obstacles[0])[None, :], path, seen)
    return seen._replace(station=float(station[0]), inside=float(inside[0]))


def _fitted(path):
    """Return centre, radius and turn (left 1) of the circle through the corners of a polyline."""
    a, b, c = path[:-2], path[1:-1], path[2:]
    into, chord = (b - a).T, (c - a).T
    out = (c - b).T
    twice_area = into[0] * out[1] - into[1] * out[0]
    curvature = 2 * twice_area / (np.hypot(*into) * np.hypot(*out) * np.hypot(*chord))
    mean = float(np.mean(curvature))
    if mean == 0 or np.ptp(curvature) > ROUNDNESS * abs(mean):
        raise BagError('the coarse path is no circle; distances compare on circle_20m')
    normal = np.array([-chord[1], chord[0]]) / np.hypot(*chord)
    return np.mean(b.T + normal / mean, axis=1), 1 / abs(mean), float(np.sign(mean))


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
    ahead = drive.facts.circles[0]
    points = np.column_stack(
        [motion.x + ahead * np.cos(motion.yaw), motion.y + ahead * np.sin(motion.yaw)]
    )
    station, inside = _coordinates(points, path, circle)
    place = _position_at_rest(drive.scene.obstacles[0])
    # the same station, mirrored at the path
    outwards = (place - circle.centre) / np.hypot(*(place - circle.centre))
    mirrored = place + 2 * circle.inside * outwards
    gap = station - circle.station
    found = [
        Distances(
            np.hypot(gap, inside - offset) - circle.reach,
            np.hypot(*(points - spot).T) - circle.reach,
        )
        for spot, offset in ((place, circle.inside), (mirrored, -circle.inside))
    ]
    return DrivenDistances(station, inside, *found)
