"""The figure of the paper's first experiment: two sketches, two distances, their difference.

The sketches show one moment in both frames; the curves are closed forms, the points are the poses
of the recorded drive.
"""

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bags.pictures import figures, palette
from bags.pictures.distance_sketch import (
    FRAMES,
    MOMENT_M,
    along_the_path,
    dash,
    on_the_ground,
    sides,
)
from bags.verdict import two_frames

SIZE = (15.0, 9.2)  # inch
STEM = 'distances'
GAPS_M = {10.0: '#009E73', 20.0: '#CC79A7', 30.0: '#000000'}  # of the curves over curvature
EVERY = 400  # of the recorded poses one in this many is drawn
SHARE = 1.2  # of the circle's own curvature, how far the curvature axis goes


def write(drive, circle, driven, folder):
    """Write the figure into `folder` as PNG and SVG; return the paths written."""
    with mpl.rc_context(palette.RC):
        figure = Figure(figsize=SIZE, layout='constrained')
        figure.get_layout_engine().set(w_pad=0.12, h_pad=0.12)
        top, bottom = figure.subplots(2, 3)
        on_the_ground(top[0], drive, circle)
        along_the_path(top[1], drive, circle)
        over_curvature(top[2], circle)
        for ax, side, inside in (
            (bottom[0], 'inside', abs(circle.inside)),
            (bottom[1], 'outside', -abs(circle.inside)),
        ):
            over_distance(ax, circle, driven, side, inside)
        difference(bottom[2], circle, driven)
        figures.letter(figure)
        figure.suptitle(
            f'Distance to an obstacle beside a circle of {circle.radius:.0f} m, in two frames',
            x=0.012,
            ha='left',
            fontsize=14,
            fontweight='bold',
        )
        figure.legend(handles=_keys(drive), loc='outside lower center', ncols=5, handlelength=2.2)
        return figures.save(figure, folder / STEM)


def over_curvature(ax, circle):
    """Draw the overestimation over the curvature of the path."""
    curvature = np.linspace(1e-4, SHARE / circle.radius, 200)
    for gap, colour in GAPS_M.items():
        for side, inside in sides(circle).items():
            # beyond half a lap the obstacle is nearer the other way round
            known = gap * curvature <= np.pi
            found = two_frames.on_circle(1 / curvature[known], gap, inside, circle.reach)
            label = f'{gap:.0f} m before it' if side == 'inside' else None
            ax.plot(
                curvature[known], found.overestimation, color=colour, ls=dash(side), label=label
            )
    ax.axvline(1 / circle.radius, color=palette.EDGE, lw=0.8, ls=':')
    ax.legend(loc='upper left')
    ax.set(xlabel='curvature of the path [1/m]', ylabel='Frenet $-$ Cartesian [m]')
    ax.set_title('Overestimation over curvature')


def over_distance(ax, circle, driven, side, inside):
    """Draw both distances over the distance driven, obstacle on one side of the path."""
    lap = np.linspace(circle.station - np.pi * circle.radius, circle.station, 400)
    lap = np.concatenate([lap, 2 * circle.station - lap[-2::-1]])
    found = two_frames.on_circle(circle.radius, lap - circle.station, inside, circle.reach)
    own = driven.distances if inside * circle.inside > 0 else driven.beyond
    for name, colour in FRAMES.items():
        ax.plot(lap, getattr(found, name), color=colour)
        ax.plot(driven.station[::EVERY], getattr(own, name)[::EVERY], 'o', ms=3, color=colour)
    ax.axhspan(-100.0, 0.0, color=palette.COLLISION, alpha=0.18, lw=0)
    low = min(found.cartesian.min(), own.cartesian.min())
    ax.set_ylim(low - 1.5, found.frenet.max() + 1.0)
    ax.set_xlim(lap[0], lap[-1])
    imagined = '' if own is driven.distances else ', imagined'
    ax.set(xlabel='distance driven [m]', ylabel='$D_{V2O}$ [m]')
    ax.set_title(f'Obstacle {side} the circle{imagined}')


def difference(ax, circle, driven):
    """Draw by how much path coordinates overestimate while the obstacle comes nearer."""
    gap = np.linspace(0.0, 2 * MOMENT_M, 300)
    before = driven.station <= circle.station
    for side, inside in reversed(sides(circle).items()):
        found = two_frames.on_circle(circle.radius, gap, inside, circle.reach)
        ax.plot(gap, found.overestimation, color=palette.INK, ls=dash(side), label=side)
        own = driven.distances if inside * circle.inside > 0 else driven.beyond
        ax.plot(
            (circle.station - driven.station)[before][:: EVERY // 2],
            own.overestimation[before][:: EVERY // 2],
            'o',
            ms=3,
            color=palette.INK,
        )
    ax.axhline(0.0, color=palette.EDGE, lw=0.8)
    ax.set(xlim=(gap[-1], 0.0), ylim=(-1.0, found.overestimation.max() + 1.5))
    ax.legend(loc='upper right')
    ax.set(xlabel='path still to drive to the obstacle [m]', ylabel='Frenet $-$ Cartesian [m]')
    ax.set_title('Overestimation over distance')


def _keys(drive):
    named = {'cartesian': 'on the ground (Cartesian)', 'frenet': 'path coordinates (Frenet)'}
    keys = [Line2D([], [], color=FRAMES[name], label=label) for name, label in named.items()]
    driven = f'poses driven by {drive.facts.controller}'
    for side in ('inside', 'outside'):
        keys.append(Line2D([], [], color=palette.INK, ls=dash(side), label=f'obstacle {side}'))
    keys.append(Line2D([], [], color=palette.INK, ls='', marker='o', ms=3, label=driven))
    return keys
