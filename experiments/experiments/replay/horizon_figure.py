"""The figure of one tick's plan: from above; states, inputs and distances over the horizon."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from bags.figures import style
from experiments.replay.resolve import HEADS, Answer

WIDTH = 14.0  # inch
MARGIN_M = 3.0
CIRCLE_EVERY = 5  # stages
FAR_M = 5.0  # distances beyond this are not drawn
KILO = 1e3
SOLVED = style.Look(style.KNOWN['mpcc'], width=style.WIDTHS[0]).line
CHANGED = style.Look(style.KNOWN['frenet'], style.DASHED).line


# quantities over the horizon: title, unit, name of the state or input, factor of its SI value
PANELS = (
    ('Speed', '$v_x$ [m/s]', 'vx', 1.0),
    ('Road-wheel angle', '$\\delta$ [deg]', 'delta', np.degrees(1.0)),
    ('Longitudinal force', '$F_x$ [kN]', 'Fx', 1 / KILO),
    ('Yaw rate', '$r$ [deg/s]', 'r', np.degrees(1.0)),
    ('Steering rate', '$\\dot\\delta$ [deg/s]', 'd_delta', np.degrees(1.0)),
    ('Force rate', '$\\dot F_x$ [kN/s]', 'd_Fx', 1 / KILO),
)


def write(answer: Answer, stem: Path) -> list[Path]:
    """Write the figure as `stem`.png and .svg; return both paths."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    drawn = [*zip(answer.both, (SOLVED, CHANGED))]  # solutions and their line styles
    with mpl.rc_context(style.RC):
        return style.save_figure(_sheet(answer, drawn), stem)


def _sheet(answer, drawn):
    low, high = _view(answer, drawn)
    top = min(max(WIDTH * (high - low)[1] / (high - low)[0] + 0.6, 2.6), 8.0)
    figure = Figure(figsize=(WIDTH, top + 6.6), layout='constrained')
    figure.get_layout_engine().set(w_pad=0.1, h_pad=0.1)
    grid = figure.add_gridspec(3, 4, height_ratios=[top, 3.0, 3.0])
    _from_above(figure.add_subplot(grid[0, :]), answer, drawn, low, high)
    for k, panel in enumerate(PANELS):
        row, column = divmod(k, 3)
        _quantity(figure.add_subplot(grid[1 + row, column]), drawn, *panel)
    _distances(figure.add_subplot(grid[1, 3]), drawn)
    _friction(figure.add_subplot(grid[2, 3]), drawn)
    tick = answer.tick
    title = f'{answer.name}, tick {tick.number} at {tick.t_s:.2f} s: {answer.solved.status}'
    figure.suptitle(title, x=0.012, ha='left', fontsize=13, fontweight='bold')
    keys = [Line2D([], [], label=label, **look) for label, (_, look) in zip(HEADS, drawn)]
    keys.append(Line2D([], [], label='recorded plan', color=style.INK, lw=0, marker='.'))
    keys.append(Line2D([], [], label='limit', color=style.COLLISION, lw=0.9, ls=':'))
    figure.legend(handles=keys, loc='outside upper right', ncols=len(keys), handlelength=2.2)
    return figure


def _view(answer, drawn):
    """Return the corners (2,) [m] of plans and edges."""
    states = [solved.states for solved, _ in drawn]
    points = np.concatenate([np.column_stack([x['X'], x['Y']]) for x in states])
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    edges = answer.tick.inputs.edges
    for edge in (edges.left, edges.right):
        inside = edge[np.all((edge > low - MARGIN_M) & (edge < high + MARGIN_M), axis=1)]
        if len(inside):
            low, high = np.minimum(low, inside.min(axis=0)), np.maximum(high, inside.max(axis=0))
    return low, high


def _from_above(ax, answer, drawn, low, high):
    inputs = answer.tick.inputs
    for edge in (inputs.edges.left, inputs.edges.right):
        ax.plot(*edge.T, color=style.EDGE, lw=1.6, zorder=2)
    path = inputs.reference
    ax.plot(path.X, path.Y, **style.coarse_path_line())
    _unsafe(ax, answer.solved)
    for solved, look in drawn:
        _plan(ax, solved, look)
    recorded = answer.tick.prediction
    if recorded is not None:
        ax.plot(recorded.X, recorded.Y, '.', ms=3.0, color=style.INK, zorder=6)
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel='X [m]', ylabel='Y [m]')
    ax.set_aspect('equal')
    ax.set_title('From above: vehicle circles, and the safety distances of their centres')


def _plan(ax, solved, look):
    radius, offsets = solved.circles
    x = solved.states
    ax.plot(x['X'], x['Y'], zorder=4, **look)
    colour = look['color']
    circle = {'facecolor': (colour, 0.06), 'edgecolor': (colour, 0.5), 'lw': 0.7}
    for X, Y, psi in zip(*(x[name][::CIRCLE_EVERY] for name in ('X', 'Y', 'psi'))):
        for offset in offsets:
            centre = X + offset * np.cos(psi), Y + offset * np.sin(psi)
            ax.add_patch(Circle(centre, radius, **circle))


def _unsafe(ax, solved):
    """Draw obstacles where they are at the first and, if they move, at some later stages."""
    safe = {distance.name: distance.safe for distance in solved.distances}
    for obstacle in solved.obstacles:
        moves = np.hypot(obstacle.vX, obstacle.vY) * solved.t[-1] > obstacle.r_obs
        touch = obstacle.r_obs + solved.circles[0]
        strength = 0.4 if moves else 1.0
        for t in solved.t[:: 2 * CIRCLE_EVERY] if moves else solved.t[:1]:
            centre = obstacle.position(t)
            for reach, colour, alpha in (
                (touch + safe[f'obstacle {obstacle.id}'], style.UNSAFE, 0.22),
                (touch, style.COLLISION, 0.16),
            ):
                face = (colour, alpha * strength)
                ax.add_patch(Circle(centre, reach, facecolor=face, edgecolor=colour, lw=0.7))
            face = (style.EDGE, strength)
            ax.add_patch(Circle(centre, obstacle.r_obs, facecolor=face, edgecolor='none', zorder=3))


def _quantity(ax, drawn, title, unit, name, factor):
    for solved, look in drawn:
        if name in solved.states:
            ax.plot(solved.t, factor * solved.states[name], **look)
        else:
            held = factor * solved.inputs[name]
            ax.step(solved.t, np.append(held, held[-1]), where='post', **look)
        for limit in solved.limits.get(name, ()):
            ax.axhline(factor * limit, color=style.COLLISION, lw=0.9, ls=':', zorder=1)
    ax.set(xlabel='t [s]', ylabel=unit, title=title)


def _distances(ax, drawn):
    for solved, look in drawn:
        for distance in solved.distances:
            strong = distance.name.startswith('obstacle')
            near = np.where(distance.D < FAR_M, distance.D, np.nan)
            ax.plot(solved.t, near, **look, alpha=1.0 if strong else 0.4)
    first = drawn[0][0]
    safe = max((d.safe for d in first.distances), default=0.0)
    ax.axhspan(0.0, safe, color=style.UNSAFE, alpha=0.22, lw=0)
    ax.axhspan(-FAR_M, 0.0, color=style.COLLISION, alpha=0.18, lw=0)
    least = min((np.min(d.D) for solved, _ in drawn for d in solved.distances), default=0.0)
    ax.set(xlim=first.t[[0, -1]], ylim=(min(least, 0.0) - 0.3, FAR_M))
    ax.set(xlabel='t [s]', ylabel='D [m]', title='Distances (edges pale)')


def _friction(ax, drawn):
    for solved, look in drawn:
        for axle, alpha in (('f', 1.0), ('r', 0.45)):
            ax.plot(solved.t, solved.friction[axle], **look, alpha=alpha)
    ax.axhline(1.0, color=style.COLLISION, lw=0.9, ls=':')
    ax.set(xlabel='t [s]', ylabel='$F / \\mu F_z$', title='Friction use (rear pale)', ylim=(0, 1.1))
