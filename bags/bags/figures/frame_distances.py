"""The paper's first experiment: the distance to an obstacle in Cartesian and in Frenet coordinates.

On a circular path (section "Cartesian vs Frenet Reference Frame") the distance of a vehicle to an
obstacle is sqrt(ds^2 + de^2) - radii in Frenet coordinates, as in the baseline, and the chord less
the radii in Cartesian coordinates. Closed forms of plane trigonometry, in metres; no code is shared
with the controllers.

In the figure two sketches show one moment in both frames; the curves of both distances and of their
difference are closed forms, the points are the poses of a recorded drive.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Circle as Disc

from bags.errors import BagError
from bags.evaluation.drive import Drive, circle_centres
from bags.figures import style

ROUNDNESS = 1e-3  # relative deviation of a reference's radius below which it is a circle
EARLY_LAPS = 0.01  # laps before the start of the path that still count as its start
GAPS_M = (2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0)  # along the path, those of the table
WIDER = (1.0, 2.0, 5.0, 10.0)  # radii of the table, in those of the circle
CLOSE = 1e-4  # relative; a gap next to the obstacle, and squared the precision of a bisection
FRAMES = {'cartesian': '#0072B2', 'frenet': '#D55E00'}
MOMENT_M = 24.0  # gap along the path at which the sketches are drawn
SIZE = (15.0, 9.2)  # inch
STEM = 'distances'
DASHES = {'inside': '-', 'outside': (0, (5, 1.5))}  # the colours stand for frames: by side
CURVE_GAPS_M = {10.0: '#009E73', 20.0: '#CC79A7', 30.0: '#000000'}  # of the curves over curvature
EVERY = 400  # of the recorded poses one in this many is drawn
SHARE = 1.2  # of the circle's own curvature, how far the curvature axis goes
FILE = 'distances.json'


class Distances(NamedTuple):
    """D_V2O [m] of the same situations, measured in two ways."""

    frenet: np.ndarray
    cartesian: np.ndarray

    @property
    def overestimation(self):
        """By how much Frenet coordinates overestimate the distance [m]."""
        return self.frenet - self.cartesian


class Circle(NamedTuple):
    """A path of constant curvature and one obstacle beside it."""

    centre: np.ndarray  # (2,) m, map
    radius: float  # m, of the path
    turn: float  # 1 when the path turns left, -1 when it turns right
    start: np.ndarray  # (2,) m, map, the first point of the path
    obstacle: np.ndarray  # (2,) m, map
    reach: float  # m, radii of obstacle and vehicle together
    station: float = 0.0  # m, of the obstacle along the path
    inside: float = 0.0  # m from the path towards its centre, of the centre of the obstacle

    def coordinates(self, points):
        """Return the station along the circle and the distance inside of it [m] of points (m, 2).

        The points are in driving order, the first of them on the first lap of the path.
        """
        away, start = points - self.centre, self.start - self.centre
        bearing = np.unwrap(np.arctan2(away[:, 1], away[:, 0])) - np.arctan2(start[1], start[0])
        laps = self.turn * bearing / (2 * np.pi)
        laps -= np.floor(laps[0] + EARLY_LAPS)
        return 2 * np.pi * self.radius * laps, self.radius - np.hypot(*away.T)

    @property
    def sides(self) -> dict[str, float]:
        """How far inside the path an obstacle on either side of it is [m]."""
        return {'inside': abs(self.inside), 'outside': -abs(self.inside)}

    @property
    def own_side(self) -> str:
        """The side of the obstacle."""
        return 'inside' if self.inside > 0 else 'outside'

    def distances(self, gap, side: str, vehicle=0.0) -> Distances:
        """Return the `circle_distances` to an obstacle on one side of the path."""
        return circle_distances(self.radius, gap, self.sides[side], self.reach, vehicle)


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


def find_circle(drive: Drive) -> Circle:
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
    places = np.column_stack([obstacles[0].x, obstacles[0].y])
    places = places[np.all(np.isfinite(places), axis=1)]
    if np.any(np.ptp(places, axis=0) > 0):
        raise BagError('the obstacle moves; distances compare at one that rests')
    reach = obstacles[0].radius + drive.facts.vehicle_radius
    circle = Circle(centre, 1 / abs(mean), turn, path[0], places[0], reach)
    station, inside = circle.coordinates(places[:1])
    return circle._replace(station=float(station[0]), inside=float(inside[0]))


def driven_distances(drive: Drive, circle: Circle) -> DrivenDistances:
    """Return the distances at the recorded poses of a drive, first circle of the vehicle."""
    (points,) = circle_centres(drive.motion, drive.facts.circles[:1])
    station, inside = circle.coordinates(points)
    outwards = circle.obstacle - circle.centre
    outwards = outwards / np.hypot(*outwards)
    gap, distances = station - circle.station, {}
    for side, offset in circle.sides.items():
        # at the same station
        spot = circle.obstacle + (circle.inside - offset) * outwards
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
        form = circle.distances(gap, side, driven.inside)
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


def _sketch(ax, drive, circle, spots, vehicle, frame):
    colour = FRAMES[frame]
    own = drive.scene.obstacles[0].radius
    for side, spot in spots.items():
        shown = 1.0 if side == circle.own_side else 0.3
        ax.add_patch(Disc(spot, own, facecolor=(style.EDGE, shown), lw=0))
        ax.plot(*zip(vehicle, spot), color=colour, ls=DASHES[side], lw=1.4)
    ax.add_patch(
        Disc(vehicle, drive.facts.vehicle_radius, facecolor=(colour, 0.25), edgecolor=colour)
    )
    D = getattr(circle.distances(MOMENT_M, 'inside'), frame)
    middle = np.mean([vehicle, spots['inside']], axis=0)
    ax.annotate(
        f'$D_{{V2O}}$ = {D:.2f} m',
        middle,
        (-10, 8 if frame == 'frenet' else -16),
        textcoords='offset points',
        ha='center' if frame == 'frenet' else 'right',
        color=colour,
    )
    ax.annotate('vehicle', vehicle, (6, -14), textcoords='offset points')
    ax.annotate('obstacle', spots['inside'], (8, 8), textcoords='offset points')
    ax.set_aspect('equal', adjustable='datalim')


def _point(circle, bearing, inside):
    reach = circle.radius - inside
    return reach * np.cos(bearing), reach * np.sin(bearing)


def _write_figure(drive, circle, driven, folder):
    with mpl.rc_context(style.RC):
        title = f'Distance to an obstacle beside a circle of {circle.radius:.0f} m, in two frames'
        figure = style.new_sheet(SIZE, title)
        top, bottom = figure.subplots(2, 3)
        angle = np.linspace(0, 2 * np.pi, 241)
        top[0].plot(*_point(circle, angle, 0.0), **style.coarse_path_line())
        at, before = (np.pi / 2 + circle.turn * s / circle.radius for s in (0.0, -MOMENT_M))
        spots = {side: _point(circle, at, inside) for side, inside in circle.sides.items()}
        _sketch(top[0], drive, circle, spots, _point(circle, before, 0.0), 'cartesian')
        labels = {'xlabel': 'X from the centre [m]', 'ylabel': 'Y from the centre [m]'}
        top[0].set(**labels, title='Cartesian coordinates')
        # the same moment in path coordinates, in which the circle is a straight line
        top[1].axhline(0.0, **style.coarse_path_line())
        spots = {side: (circle.station, circle.turn * n) for side, n in circle.sides.items()}
        _sketch(top[1], drive, circle, spots, (circle.station - MOMENT_M, 0.0), 'frenet')
        labels = {'xlabel': 's [m]', 'ylabel': 'e [m], left positive'}
        top[1].set(**labels, title='Path (Frenet) coordinates')
        _over_curvature(top[2], circle)
        for ax, side in zip(bottom, circle.sides):
            _over_distance(ax, circle, driven, side)
        _difference(bottom[2], circle, driven)
        style.letter_panels(figure)
        named = {'cartesian': 'on the ground (Cartesian)', 'frenet': 'path coordinates (Frenet)'}
        keys = [Line2D([], [], color=FRAMES[name], label=label) for name, label in named.items()]
        for side in circle.sides:
            label = f'obstacle {side}'
            keys.append(Line2D([], [], color=style.INK, ls=DASHES[side], label=label))
        point = {'color': style.INK, 'ls': '', 'marker': 'o', 'ms': 3}
        keys.append(Line2D([], [], label=f'poses driven by {drive.facts.controller}', **point))
        keys.append(Line2D([], [], label='coarse path', **style.coarse_path_line()))
        figure.legend(handles=keys, loc='outside lower center', ncols=6, handlelength=2.2)
        return style.save_figure(figure, folder / STEM)


def _over_curvature(ax, circle):
    curvature = np.linspace(1e-4, SHARE / circle.radius, 200)
    for gap, colour in CURVE_GAPS_M.items():
        for side, inside in circle.sides.items():
            # beyond half a lap the obstacle is nearer the other way round
            known = gap * curvature <= np.pi
            distances = circle_distances(1 / curvature[known], gap, inside, circle.reach)
            look = {'color': colour, 'ls': DASHES[side]}
            if side == 'inside':
                look['label'] = f'{gap:.0f} m before it'
            ax.plot(curvature[known], distances.overestimation, **look)
    ax.axvline(1 / circle.radius, color=style.EDGE, lw=0.8, ls=':')
    ax.legend(loc='upper left')
    ax.set(xlabel='curvature of the path [1/m]', ylabel='Frenet $-$ Cartesian [m]')
    ax.set_title('Overestimation over curvature')


def _over_distance(ax, circle, driven, side):
    lap = np.linspace(circle.station - np.pi * circle.radius, circle.station, 400)
    lap = np.concatenate([lap, 2 * circle.station - lap[-2::-1]])
    distances, own = circle.distances(lap - circle.station, side), driven.distances[side]
    for name, colour in FRAMES.items():
        ax.plot(lap, getattr(distances, name), color=colour)
        ax.plot(driven.station[::EVERY], getattr(own, name)[::EVERY], 'o', ms=3, color=colour)
    ax.axhspan(-100.0, 0.0, color=style.COLLISION, alpha=0.18, lw=0)
    low = min(distances.cartesian.min(), own.cartesian.min())
    ax.set_ylim(low - 1.5, distances.frenet.max() + 1.0)
    ax.set_xlim(lap[0], lap[-1])
    imagined = '' if side == circle.own_side else ', imagined'
    ax.set(xlabel='distance driven [m]', ylabel='$D_{V2O}$ [m]')
    ax.set_title(f'Obstacle {side} the circle{imagined}')


def _difference(ax, circle, driven):
    gap = np.linspace(0.0, 2 * MOMENT_M, 300)
    before = driven.station <= circle.station
    to_go = (circle.station - driven.station)[before][:: EVERY // 2]
    for side in reversed(circle.sides):
        distances = circle.distances(gap, side)
        ax.plot(gap, distances.overestimation, color=style.INK, ls=DASHES[side], label=side)
        own = driven.distances[side].overestimation[before][:: EVERY // 2]
        ax.plot(to_go, own, 'o', ms=3, color=style.INK)
    ax.axhline(0.0, color=style.EDGE, lw=0.8)
    ax.set(xlim=(gap[-1], 0.0), ylim=(-1.0, distances.overestimation.max() + 1.5))
    ax.legend(loc='upper right')
    ax.set(xlabel='path still to drive to the obstacle [m]', ylabel='Frenet $-$ Cartesian [m]')
    ax.set_title('Overestimation over distance')


def write_frame_distances(drive: Drive, out: Path) -> tuple[dict[str, Any], dict[str, Path]]:
    """Write the figure and its numbers for a drive into the folder `out`.

    Return the contents of distances.json, and the files: `numbers` and `figure`. Raises BagError
    where the path is no circle with one obstacle.
    """
    circle = find_circle(drive)
    driven = driven_distances(drive, circle)
    values = distance_numbers(drive, circle, driven)
    out.mkdir(parents=True, exist_ok=True)
    file = out / FILE
    file.write_text(json.dumps(values, indent=2, allow_nan=False) + '\n')
    figure, _ = _write_figure(drive, circle, driven, out)
    return values, {'numbers': file, 'figure': figure}
