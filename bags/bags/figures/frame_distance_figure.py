"""The figure and the numbers of the paper's first experiment, from a recorded drive on a circle.

Two sketches show one moment in both frames; the curves of both distances and of their difference
are closed forms, the points are the poses of the recorded drive.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Circle as Disc

from bags.evaluation import frame_distances
from bags.evaluation.drive import Drive
from bags.evaluation.frame_distances import circle_distances
from bags.figures import style

FRAMES = {'cartesian': '#0072B2', 'frenet': '#D55E00'}
MOMENT_M = 24.0  # gap along the path at which the sketches are drawn
SIZE = (15.0, 9.2)  # inch
STEM = 'distances'
DASHES = {'inside': '-', 'outside': (0, (5, 1.5))}  # the colours stand for frames: by side
CURVE_GAPS_M = {10.0: '#009E73', 20.0: '#CC79A7', 30.0: '#000000'}  # of the curves over curvature
EVERY = 400  # of the recorded poses one in this many is drawn
SHARE = 1.2  # of the circle's own curvature, how far the curvature axis goes
FILE = 'distances.json'


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
    inside = circle.sides['inside']
    D = getattr(circle_distances(circle.radius, MOMENT_M, inside, circle.reach), frame)
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


def write_figure(drive, circle, driven, folder):
    """Write the figure into `folder` as PNG and SVG; return the paths written."""
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
        over_curvature(top[2], circle)
        for ax, side in zip(bottom, circle.sides):
            over_distance(ax, circle, driven, side)
        difference(bottom[2], circle, driven)
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


def over_curvature(ax, circle):
    """Draw the overestimation over the curvature of the path."""
    curvature = np.linspace(1e-4, SHARE / circle.radius, 200)
    for gap, colour in CURVE_GAPS_M.items():
        for side, inside in circle.sides.items():
            # beyond half a lap the obstacle is nearer the other way round
            known = gap * curvature <= np.pi
            distances = circle_distances(1 / curvature[known], gap, inside, circle.reach)
            label = f'{gap:.0f} m before it' if side == 'inside' else None
            ax.plot(
                curvature[known],
                distances.overestimation,
                color=colour,
                ls=DASHES[side],
                label=label,
            )
    ax.axvline(1 / circle.radius, color=style.EDGE, lw=0.8, ls=':')
    ax.legend(loc='upper left')
    ax.set(xlabel='curvature of the path [1/m]', ylabel='Frenet $-$ Cartesian [m]')
    ax.set_title('Overestimation over curvature')


def over_distance(ax, circle, driven, side):
    """Draw both distances over the distance driven, obstacle on one side of the path."""
    lap = np.linspace(circle.station - np.pi * circle.radius, circle.station, 400)
    lap = np.concatenate([lap, 2 * circle.station - lap[-2::-1]])
    gap, inside = lap - circle.station, circle.sides[side]
    distances = circle_distances(circle.radius, gap, inside, circle.reach)
    own = driven.distances[side]
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


def difference(ax, circle, driven):
    """Draw by how much path coordinates overestimate while the obstacle comes nearer."""
    gap = np.linspace(0.0, 2 * MOMENT_M, 300)
    before = driven.station <= circle.station
    for side, inside in reversed(circle.sides.items()):
        distances = circle_distances(circle.radius, gap, inside, circle.reach)
        ax.plot(gap, distances.overestimation, color=style.INK, ls=DASHES[side], label=side)
        own = driven.distances[side]
        ax.plot(
            (circle.station - driven.station)[before][:: EVERY // 2],
            own.overestimation[before][:: EVERY // 2],
            'o',
            ms=3,
            color=style.INK,
        )
    ax.axhline(0.0, color=style.EDGE, lw=0.8)
    ax.set(xlim=(gap[-1], 0.0), ylim=(-1.0, distances.overestimation.max() + 1.5))
    ax.legend(loc='upper right')
    ax.set(xlabel='path still to drive to the obstacle [m]', ylabel='Frenet $-$ Cartesian [m]')
    ax.set_title('Overestimation over distance')


class FrameDistanceFiles(NamedTuple):
    """The numbers, and the files that were written."""

    values: dict[str, Any]  # distances.json
    file: Path
    figures: list[Path]


def write_frame_distances(drive: Drive, out: Path) -> FrameDistanceFiles:
    """Write the figure and its numbers for a drive into the folder `out`.

    Raises BagError where the path is no circle with one obstacle.
    """
    circle = frame_distances.find_circle(drive)
    driven = frame_distances.driven_distances(drive, circle)
    values = frame_distances.distance_numbers(drive, circle, driven)
    out.mkdir(parents=True, exist_ok=True)
    file = out / FILE
    file.write_text(json.dumps(values, indent=2, allow_nan=False) + '\n')
    return FrameDistanceFiles(values, file, write_figure(drive, circle, driven, out))
