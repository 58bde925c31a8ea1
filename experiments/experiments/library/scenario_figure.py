"""A picture of a scenario from above: road, coarse path, obstacles and their ways, friction."""

from pathlib import Path

import numpy as np

from scenario_publisher import actors
from scenario_publisher.scenario import Scenario

STEP_S = 1.0  # between two drawn places of an obstacle that moves
WIDE_INCH, MAX_DEEP_INCH, TITLE_INCH = 8.0, 3.6, 0.5
NEAR_M = 6.0  # of obstacles that share a label
MARGIN_M = 2.5
AROUND_M = 12.0  # drawn beyond start and finish
ROAD, EDGE, PATH = '#e8e8e8', '#444444', '#1f77b4'
OBSTACLE, SLIPPERY = '#c0392b', '#9bd3e6'


def draw_scenario(scn: Scenario, path: Path) -> Path:
    """Draw a scenario into a file, PNG or SVG by its suffix, and return it.

    An obstacle is dark where it appears and paler every second, numbered; the car is an arrow at
    its start, and the finish is a dotted line across the road.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle, Polygon

    left, right = scn.edges.left, scn.edges.right
    begin, end = _extent(scn)
    size = end - begin
    deep = min(MAX_DEEP_INCH, TITLE_INCH + WIDE_INCH * size[1] / size[0])
    figure = Figure(figsize=(WIDE_INCH, deep), layout='constrained')
    axes = figure.add_subplot()
    axes.add_patch(Polygon(np.concatenate([left, right[::-1]]), color=ROAD, lw=0))
    for corners in np.reshape(scn.patches.corners_m, (-1, 4, 2)):
        axes.add_patch(Polygon(corners, color=SLIPPERY, lw=0))
    for edge in (left, right):
        axes.plot(*edge.T, color=EDGE, lw=0.8)
    axes.plot(scn.reference.X, scn.reference.Y, color=PATH, lw=0.8, ls='--')
    for actor in scn.actors:
        for count, o in enumerate(_places(scn, actor)):
            alpha = 0.9 if count == 0 else 0.25
            at = Circle((o.X, o.Y), o.r_obs, color=OBSTACLE, alpha=alpha, lw=0, clip_on=True)
            axes.add_patch(at)
    for text, (x, y) in _labels(scn.actors):
        axes.annotate(
            text, (x, y), (0, 6), textcoords='offset points', fontsize=6, ha='center', va='bottom'
        )
    forward = np.array([np.cos(scn.start.psi), np.sin(scn.start.psi)])
    axes.annotate(
        '',
        np.array([scn.start.X, scn.start.Y]) + 8.0 * forward,
        (scn.start.X, scn.start.Y),
        arrowprops={'arrowstyle': '-|>', 'color': PATH, 'lw': 1.5},
    )
    across = np.array([-np.sin(scn.stop.psi), np.cos(scn.stop.psi)])
    line = np.array([scn.stop.X, scn.stop.Y]) + np.outer([-6.0, 6.0], across)
    axes.plot(*line.T, color=EDGE, ls=':', lw=1.0)
    axes.set_xlim(begin[0], end[0])
    axes.set_ylim(begin[1], end[1])
    axes.set_aspect('equal')
    axes.tick_params(labelsize=6)
    friction = '' if scn.friction == 1.0 else f', friction {scn.friction:.2g}'
    axes.set_title(f'{scn.name}: {scn.start.speed:.1f} m/s{friction}', fontsize=8, loc='left')
    # without a date, and with fixed names inside: the same scenario gives the same file
    svg = path.suffix == '.svg'
    with rc_context({'svg.fonttype': 'none', 'svg.hashsalt': scn.name}):
        metadata = {'Date': None} if svg else None
        figure.savefig(path, dpi=110, metadata=metadata, bbox_inches='tight')
    return path


def _extent(scn):
    """Return the lower left and the upper right corner [m] of what is drawn."""
    ref = scn.reference
    finish = int(np.argmin(np.hypot(ref.X - scn.stop.X, ref.Y - scn.stop.Y)))
    driven = np.column_stack([ref.X, ref.Y])[: finish + 1]
    edges = np.concatenate([scn.edges.left, scn.edges.right])
    low, high = driven.min(axis=0) - AROUND_M, driven.max(axis=0) + AROUND_M
    near = edges[np.all((edges > low) & (edges < high), axis=1)]
    places = [(actor.obstacle.X, actor.obstacle.Y) for actor in scn.actors]
    shown = np.array([*near, *(place for place in places if low[0] < place[0] < high[0])])
    return shown.min(axis=0) - MARGIN_M, shown.max(axis=0) + MARGIN_M


def _labels(crowd):
    """Yield numbers and time of appearance of neighbours that appear together, and where."""
    groups = []
    for actor in crowd:
        o = actor.obstacle
        last = groups[-1][-1] if groups else None
        is_near = last and np.hypot(o.X - last.obstacle.X, o.Y - last.obstacle.Y) < NEAR_M
        if is_near and actor.appears == last.appears:
            groups[-1].append(actor)
        else:
            groups.append([actor])
    for group in groups:
        numbers = [actor.obstacle.id for actor in group]
        text = '–'.join(map(str, dict.fromkeys((numbers[0], numbers[-1]))))
        if group[0].appears > 0.0:
            text += f', from {group[0].appears:.1f} s'
        places = [(actor.obstacle.X, actor.obstacle.Y + actor.obstacle.r_obs) for actor in group]
        yield text, (np.mean(places, axis=0)[0], np.max(places, axis=0)[1])


def _places(scn, actor):
    """Yield an obstacle every STEP_S while the car may be on its way."""
    until = min(actor.disappears, scn.stop.time, actor.appears + 8.0)
    still = actor.track is None and not (actor.obstacle.vX or actor.obstacle.vY)
    for t in [actor.appears] if still else np.arange(actor.appears, until, STEP_S):
        yield actors.obstacle_at(actor, float(t))
