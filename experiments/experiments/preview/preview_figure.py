"""A scenario from above, with safety distances, over its speed and lateral acceleration."""

from pathlib import Path

import numpy as np

from bags.evaluation import geometry
from bags.figures import style
from experiments.preview.scenario_checks import Circles
from scenario_publisher import actors, advice
from scenario_publisher.scenario import Scenario

WIDE_INCH, STRIP_INCH, LEAST_INCH, MOST_INCH = 11.0, 1.7, 2.4, 8.0
STEP_S = 1.0  # between two drawn places of an obstacle that moves
SHOWN_S = 10.0  # of the motion of an obstacle
MARGIN_M = 4.0
ROAD, PATH, OBSTACLE, SLIPPERY, SPEED = '#ececec', '#0072B2', '#CC3311', '#9bd3e6', '#009E73'


def draw(scn: Scenario, circles: Circles, path: Path) -> Path:
    """Draw a scenario into a file, PNG or SVG by its suffix; return it."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    low, high = _extent(scn)
    size = high - low
    above = float(np.clip(WIDE_INCH * size[1] / size[0], LEAST_INCH, MOST_INCH))
    with rc_context({**style.RC, 'svg.fonttype': 'none', 'svg.hashsalt': scn.name}):
        figure = Figure(figsize=(WIDE_INCH, above + 2 * STRIP_INCH), layout='constrained')
        top, speed, lateral = figure.subplots(3, 1, height_ratios=(above, STRIP_INCH, STRIP_INCH))
        speed.sharex(lateral)
        _from_above(top, scn, circles)
        # where the shape allows it the scales are equal; a long road is stretched across
        stretch = size[0] / size[1] / (WIDE_INCH / above)
        top.set_xlim(low[0], high[0])
        top.set_ylim(low[1], high[1])
        if stretch < 1.5:
            top.set_aspect('equal', adjustable='box')
        _strips(speed, lateral, scn)
        scale = f'; across stretched {stretch:.1f} times' if stretch >= 1.5 else ''
        top.set_title(f'{scn.name}: {scn.start.speed:.1f} m/s, friction {scn.friction:g}{scale}')
        figure.legend(*top.get_legend_handles_labels(), loc='outside lower center', ncols=7)
        figure.savefig(path, dpi=130, metadata={'Date': None} if path.suffix == '.svg' else None)
    return path


def _from_above(axes, scn, circles):
    from matplotlib.patches import Circle, Polygon

    left, right = scn.edges.left, scn.edges.right
    axes.add_patch(Polygon(np.concatenate([left, right[::-1]]), color=ROAD, lw=0, label='road'))
    for i, corners in enumerate(np.reshape(scn.patches.corners_m, (-1, 4, 2))):
        axes.add_patch(Polygon(corners, color=SLIPPERY, lw=0, label='' if i else 'other friction'))
    for edge in (left, right):
        axes.plot(*edge.T, color=style.EDGE, lw=1.0)
    for edge, inside in ((left, -circles.edge_m), (right, circles.edge_m)):
        safe = geometry.offset_polyline(edge, inside)
        axes.plot(*safe.T, color=style.UNSAFE, lw=0.8, ls=':')
    axes.plot(scn.reference.X, scn.reference.Y, color=PATH, lw=1.4, label='coarse path')
    named = set()
    for actor in scn.actors:
        for count, (t, o) in enumerate(_places(scn, actor)):
            alpha = 0.85 if count == 0 else 0.25
            for d in o.discs():
                axes.add_patch(Circle((d.X, d.Y), d.r_obs, color=OBSTACLE, alpha=alpha, lw=0))
                safe = d.r_obs + circles.obstacle_m
                ring = Circle((d.X, d.Y), safe, fill=False, ec=style.UNSAFE, ls=':', lw=0.8)
                axes.add_patch(ring)
            if count and count % 2 == 0:
                axes.annotate(f'{t:.0f} s', (o.X, o.Y), fontsize=6.5, ha='center', va='center')
        o = actor.obstacle
        if np.hypot(o.vX, o.vY) or actor.track is not None:
            way = np.array([(p.X, p.Y) for _, p in _places(scn, actor, 0.1)])
            axes.plot(*way.T, color=OBSTACLE, lw=0.8, ls='--')
        text = f'{o.id}' + (f', from {actor.appears:g} s' if actor.appears else '')
        if (text, round(o.X), round(o.Y)) not in named:
            named.add((text, round(o.X), round(o.Y)))
            axes.annotate(
                text, (o.X, o.Y + o.r_obs), (0, 5), textcoords='offset points', ha='center'
            )
    start = (scn.start.X, scn.start.Y)
    axes.add_patch(Circle(start, circles.radius_m, fill=False, ec=PATH, lw=1.2))
    forward = np.array([np.cos(scn.start.psi), np.sin(scn.start.psi)])
    axes.annotate(
        '', np.array(start) + 8.0 * forward, start, arrowprops={'arrowstyle': '-|>', 'color': PATH}
    )
    across = np.array([-np.sin(scn.stop.psi), np.cos(scn.stop.psi)])
    line = np.array([scn.stop.X, scn.stop.Y]) + np.outer([-6.0, 6.0], across)
    axes.plot(*line.T, color=style.INK, ls=(0, (2, 2)), lw=1.2, label='finish')
    axes.plot([], [], color=style.UNSAFE, ls=':', lw=0.8, label='safety distance')
    axes.plot([], [], 'o', color=OBSTACLE, label='obstacle, every second')
    axes.plot([], [], 'o', mfc='none', color=PATH, label='circle of the car')
    axes.set_xlabel('x [m]')
    axes.set_ylabel('y [m]')


def _strips(speed, lateral, scn):
    along = advice.path_demand(scn)
    speed.plot(along.station, along.speed, color=SPEED)
    speed.set_ylabel('desired\nspeed [m/s]')
    speed.set_ylim(0.0, 1.25 * along.speed.max())
    limit = along.friction * advice.GRAVITY
    lateral.plot(along.station, along.lateral, color=PATH)
    for sign in (-1.0, 1.0):
        lateral.plot(along.station, sign * limit, color=style.COLLISION, ls=':', lw=0.9)
    lateral.annotate(
        'friction x g',
        (along.station[0], limit[0]),
        (2, -10),
        fontsize=7.5,
        textcoords='offset points',
        color=style.COLLISION,
    )
    reach = max(1.15 * limit.max(), 1.1 * np.abs(along.lateral).max())
    lateral.set_ylim(-reach, reach)
    lateral.set_ylabel('lateral acc. of\nthe path [m/s²]')
    lateral.set_xlabel('station of the path [m]')
    lateral.set_xlim(along.station[0], along.station[-1])
    for axes in (speed, lateral):
        axes.axvline(advice.finish_station(scn), color=style.INK, ls=(0, (2, 2)), lw=1.2)


def _places(scn, actor, step=STEP_S):
    """Yield times and an obstacle at them, while it is there."""
    until = min(actor.disappears, scn.stop.time, actor.appears + SHOWN_S)
    still = actor.track is None and not (actor.obstacle.vX or actor.obstacle.vY)
    for t in [actor.appears] if still else np.arange(actor.appears, until, step):
        yield float(t), actors.obstacle_at(actor, float(t))


def _extent(scn):
    """Return the corners [m] of what is drawn: the path and the road beside it."""
    ref = scn.reference
    path = np.column_stack([ref.X, ref.Y])
    low, high = path.min(axis=0) - 12.0, path.max(axis=0) + 12.0
    edges = np.concatenate([scn.edges.left, scn.edges.right])
    near = edges[np.all((edges > low) & (edges < high), axis=1)]
    shown = np.concatenate([path, near])
    return shown.min(axis=0) - MARGIN_M, shown.max(axis=0) + MARGIN_M
