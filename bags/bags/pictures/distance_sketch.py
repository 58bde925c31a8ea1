"""Sketches of the paper's first experiment: one moment on the circle, seen in both frames."""

import numpy as np
from matplotlib.patches import Circle as Disc

from bags.pictures import palette
from bags.verdict import two_frames

FRAMES = {'cartesian': '#0072B2', 'frenet': '#D55E00'}
DASHED = (0, (5, 1.5))
MOMENT_M = 24.0  # gap along the path at which the sketches are drawn


def on_the_ground(ax, drive, circle):
    """Sketch the scenario in Cartesian coordinates."""
    angle = np.linspace(0, 2 * np.pi, 241)
    ax.plot(*_at(circle, angle, 0.0), color=palette.REFERENCE, lw=1.2, ls=(0, (6, 3)))
    spots = {side: _at(circle, _bearing(circle, 0.0), n) for side, n in sides(circle).items()}
    vehicle = _at(circle, _bearing(circle, -MOMENT_M), 0.0)
    _scene(ax, drive, circle, spots, vehicle, 'cartesian')
    ax.set(xlabel='X from the centre [m]', ylabel='Y from the centre [m]')
    ax.set_title('Cartesian coordinates')
    ax.set_aspect('equal', adjustable='datalim')


def along_the_path(ax, drive, circle):
    """Sketch the same moment in path coordinates, in which the circle is a straight line."""
    ax.axhline(0.0, color=palette.REFERENCE, lw=1.2, ls=(0, (6, 3)))
    left = {side: circle.turn * n for side, n in sides(circle).items()}
    spots = {side: (circle.station, e) for side, e in left.items()}
    vehicle = (circle.station - MOMENT_M, 0.0)
    _scene(ax, drive, circle, spots, vehicle, 'frenet')
    ax.set(xlabel='s [m]', ylabel='e [m], left positive')
    ax.set_title('Path (Frenet) coordinates')
    ax.set_aspect('equal', adjustable='datalim')


def _scene(ax, drive, circle, spots, vehicle, frame):
    colour = FRAMES[frame]
    own = drive.scene.obstacles[0].radius
    for side, spot in spots.items():
        shown = (side == 'inside') == (circle.inside > 0)
        ax.add_patch(Disc(spot, own, facecolor=(palette.EDGE, 1.0 if shown else 0.3), lw=0))
        ax.plot(*zip(vehicle, spot), color=colour, ls=dash(side), lw=1.4)
    ax.add_patch(
        Disc(vehicle, drive.facts.vehicle_radius, facecolor=(colour, 0.25), edgecolor=colour)
    )
    inside = sides(circle)['inside']
    D = getattr(two_frames.on_circle(circle.radius, MOMENT_M, inside, circle.reach), frame)
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


def _bearing(circle, past):
    """Return the bearing [rad] from the centre of a point `past` [m] behind the obstacle."""
    return np.pi / 2 + circle.turn * past / circle.radius


def _at(circle, bearing, inside):
    reach = circle.radius - inside
    return reach * np.cos(bearing), reach * np.sin(bearing)


def sides(circle):
    """Return how far inside the path an obstacle on either side of it is [m]."""
    return {'inside': abs(circle.inside), 'outside': -abs(circle.inside)}


def dash(side):
    """Return the line style that stands for a side."""
    return '-' if side == 'inside' else DASHED
