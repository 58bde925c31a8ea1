"""The panels of a comparison, for figures and page: each shows every run on one pair of axes.

They follow the paper's double-lane-change figure: distances to edges and obstacles, velocity,
sideslip angle, road-wheel angle, longitudinal force, and the G-G diagram, under its captions; the
page has more of them. In a figure they are against the station, and the closest approaches to
obstacles are enlarged.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from bags.evaluation.drive import WHY, report_numbers
from bags.evaluation.metrics.driving import GRAVITY
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.figures import style

NEAR_M = 1.2  # distances up to this are enlarged
BELOW_M = 0.35  # shown below the smallest one, so that the collision area is seen
ASIDE_M = 14.0  # m of stations taken by the curves either side of a closest approach
LEAST_SHARE = 0.15  # of the width; in a narrower gap nothing is enlarged
FILL = 0.72  # of a gap, the rest is for the labels left of it
TICKS_M = (0.0, 0.5, 1.0)
BOTTOM, HEIGHT = 0.44, 0.46  # of the panel
EVERY = 10  # of the 1 kHz samples one in this many is drawn
FAR_M = 5.0  # distances beyond this are safe, and not drawn
SPARE = 0.05  # of the span of the values, left free above and below them
LEAST_MARGIN_M = 0.1  # of stations: a car that stands has only one
KILO = 1e3
STATION = 'station along the coarse path [m]'


def shade_unsafe(ax, safe):
    """Shade the unsafe area below the safety distance [m], darker where the circles overlap."""
    ax.axhspan(0.0, safe, color=style.UNSAFE, alpha=0.22, lw=0)
    ax.axhspan(-100.0, 0.0, color=style.COLLISION, alpha=0.18, lw=0)
    ax.axhline(safe, color=style.UNSAFE, lw=0.8)
    ax.axhline(0.0, color=style.COLLISION, lw=0.8)


def draw_insets(ax, runs):
    """Enlarge the closest approach to every obstacle that has free room of the panel beside it."""
    approached = {}
    for run in runs:
        for number, gap in run.series.v2o.items():
            if np.any(gap < NEAR_M):
                station = float(run.series.station[np.nanargmin(gap)])
                approached.setdefault(number, []).append(station)
    middles = {number: float(np.mean(at)) for number, at in approached.items()}
    order = sorted(middles, key=middles.get)
    # stations that no curve crosses, by place, those wide enough
    low, high = ax.get_xlim()
    begins = [low, *(middles[number] + ASIDE_M for number in order)]
    ends = [*(middles[number] - ASIDE_M for number in order), high]
    gaps, wide = enumerate(zip(begins, ends)), LEAST_SHARE * (high - low)
    free = {k: gap for k, gap in gaps if gap[1] - gap[0] >= wide}
    for k, number in enumerate(order):
        # one before and one behind the approach
        beside = [side for side in (k, k + 1) if side in free]
        if beside:
            widest = max(beside, key=lambda side: free[side][1] - free[side][0])
            _inset(ax, runs, number, free.pop(widest))


def _inset(ax, runs, number, gap):
    # imported late: pages use this module, too
    from matplotlib.ticker import MaxNLocator

    low, high = ax.get_xlim()
    width = FILL * (gap[1] - gap[0]) / (high - low)
    right = (gap[1] - low) / (high - low)
    inner = ax.inset_axes((right - width, BOTTOM, width, HEIGHT))
    reach, least = [], 0.0
    for run in runs:
        distance, station = run.series.v2o[number], run.series.station
        near = distance < NEAR_M
        if np.any(near):
            inner.plot(station[near], distance[near], **run.look.line)
            reach += [station[near].min(), station[near].max()]
            least = min(least, float(np.nanmin(distance)))
    shade_unsafe(inner, max(run.drive.facts.safe_obstacle for run in runs))
    inner.set(xlim=(min(reach), max(reach)), ylim=(least - BELOW_M, NEAR_M))
    inner.set(yticks=TICKS_M)
    # labels of three digits do not touch in a narrow one
    inner.xaxis.set_major_locator(MaxNLocator(nbins=2, integer=True, steps=[1, 2, 5, 10]))
    inner.set_title(f'obstacle {number}', fontsize=7.5, fontweight='normal', loc='center', pad=3.0)
    inner.tick_params(labelsize=6.5, length=2.0)
    inner.set_facecolor('white')
    for side in ('top', 'right'):
        inner.spines[side].set_visible(True)


class Panel(NamedTuple):
    """One pair of axes against the station, or against time."""

    name: str  # as overlays call it; also the id of its element on the page
    title: str
    axis: str  # label of the vertical axis with its unit, for Matplotlib
    safe: str = ''  # the field of Facts with the safety distance, '' where that has no meaning
    # of the axis: noise is not to fill it, and 0.1 m/s not to look like braking; 0: it begins at 0
    least_span: float = 0.0
    least_top: float = 0.0  # of an axis that begins at 0


# of the friction the share that the controller's model uses
PANELS = (
    Panel('v2o', 'Vehicle-to-obstacle distance', '$D_{V2O}$ [m]', 'safe_obstacle'),
    Panel('v2e_left', 'Vehicle-to-edge distance, left', '$D_{V2E}$ [m]', 'safe_edge'),
    Panel('v2e_right', 'Vehicle-to-edge distance, right', '$D_{V2E}$ [m]', 'safe_edge'),
    Panel('contouring', 'Distance from the coarse path', 'left positive [m]', least_span=0.5),
    Panel('velocity', 'Longitudinal velocity', '$v_x$ [m/s]', least_span=5.0),
    Panel('sideslip', 'Vehicle sideslip angle', '$β$ [deg]', least_span=2.0),
    Panel('lateral', 'Lateral acceleration', '$a_y$ [m/s²]', least_span=2.0),
    Panel('steer', 'Road-wheel angle', '$δ$ [deg]', least_span=2.0),
    Panel('force', 'Longitudinal force input', '$F_x$ [kN], braking negative', least_span=2.0),
    Panel('friction_front', 'Friction use in the controller, front', 'F / µF_z', least_top=1.05),
    Panel('friction_rear', 'Friction use in the controller, rear', 'F / µF_z', least_top=1.05),
    Panel('solve', 'Solve time per tick', '[ms]', least_top=20.0),
)
Curve = tuple[np.ndarray, np.ndarray]  # stamps (n,) [ns] and values (n,)


def _reported(key, run):
    why = run.tables.get(WHY)
    return [(why.stamp_ns, report_numbers(why.values, key))] if why else []


# of a run by panel, none where nothing was recorded
CURVES: Mapping[str, Callable[[EvaluatedDrive], list[Curve]]] = {
    'v2o': lambda run: [(run.stamp_ns, gap) for gap in run.series.v2o.values()],
    'v2e_left': lambda run: [(run.stamp_ns, run.series.v2e['left'])],
    'v2e_right': lambda run: [(run.stamp_ns, run.series.v2e['right'])],
    'contouring': lambda run: [(run.stamp_ns, run.series.contouring)],
    'velocity': lambda run: [(run.stamp_ns, run.drive.motion.vx)],
    'sideslip': lambda run: [(run.stamp_ns, np.degrees(run.series.sideslip))],
    'lateral': lambda run: [(run.drive.accelerations.stamp_ns, run.drive.accelerations.ay)],
    'steer': lambda run: [(run.drive.inputs.stamp_ns, np.degrees(run.drive.inputs.steer))],
    'force': lambda run: [(run.drive.inputs.stamp_ns, run.drive.inputs.force / KILO)],
    'friction_front': partial(_reported, 'friction.front'),
    'friction_rear': partial(_reported, 'friction.rear'),
    'solve': partial(_reported, 'time.solve_ms'),
}


def axis_limits(least_span: float, columns: Iterable[np.ndarray]) -> tuple[float, float]:
    """Return the limits of a vertical axis: those of its values, at least so far apart."""
    finite = [column[np.isfinite(column)] for column in columns]
    values = np.concatenate([np.empty(0), *finite])
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    half = max((0.5 + SPARE) * (high - low), least_span / 2)
    return (low + high) / 2 - half, (low + high) / 2 + half


def safe_distance(runs: Sequence[EvaluatedDrive], panel: Panel) -> float:
    """Return the largest safety distance [m] of runs in a panel that has one."""
    return max(getattr(run.drive.facts, panel.safe) for run in runs)


def draw_panel(ax, runs: Sequence[EvaluatedDrive], panel: Panel) -> None:
    """Draw the curves of runs, and the extremes that the metrics report.

    Of distances the unsafe area is shaded; small ones are shown, and half a metre below the
    smallest.
    """
    curves = [(run, *curve) for run in runs for curve in CURVES[panel.name](run)]
    for run, stamp_ns, values in curves:
        shown = np.where(values < 2 * FAR_M, values, np.nan) if panel.safe else values
        ax.plot(run.station_at(stamp_ns[::EVERY]), shown[::EVERY], **run.look.line)
    _along(ax, runs)
    ax.set(ylabel=panel.axis, title=panel.title)
    if panel.safe:
        near = [(run, gap) for run, _, gap in curves if np.any(gap < FAR_M)]
        for run, gap in near:
            _mark(ax, run, np.nanargmin(gap), gap)
        if not near:
            side = panel.name.removeprefix('v2e_')
            far = 'no obstacle within' if panel.name == 'v2o' else f'{side} edge beyond'
            look = {'transform': ax.transAxes, 'ha': 'center', 'color': style.QUIET}
            ax.text(0.5, 0.6, f'{far} {FAR_M:g} m', **look)
        shade_unsafe(ax, safe_distance(runs, panel))
        ax.set_ylim(min([0.0, *(np.nanmin(gap) for _, gap in near)]) - 0.5, FAR_M)
    else:
        ax.set_ylim(axis_limits(panel.least_span, [values for *_, values in curves]))
    if panel.name == 'v2o':
        draw_insets(ax, runs)
    if panel.name == 'force':
        ax.axhline(0.0, color=style.EDGE, lw=0.6, zorder=1)
    for run, _, angle in curves if panel.name == 'sideslip' else ():
        if not np.all(np.isnan(angle)):
            _mark(ax, run, np.nanargmax(np.abs(angle)), angle)


def draw_gg(ax, runs):
    """Draw the accelerations at the centre of gravity, and µg as the controller believes it."""
    for run in runs:
        acc = run.drive.accelerations
        ax.plot(acc.ay, acc.ax, **{**run.look.line, 'linewidth': 0.6 * run.look.width})
    circle, reach = friction_circle(runs)
    ax.plot(*circle, color=style.EDGE, lw=1.0)
    note(ax, 'circle: µg, as the controller\nbelieves of sliding tyres')
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach))
    ax.set_aspect('equal', adjustable='box')
    # keeps its title level with those of its neighbours
    ax.set_anchor('N')
    ax.set(xlabel='$a_y$ [m/s²], left positive', ylabel='$a_x$ [m/s²]', title='G-G diagram')


def friction_circle(runs):
    """Return points (2, n) of the circle of µg, and how far the axes go; all in m/s²."""
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    radius = GRAVITY * max(run.drive.facts.friction for run in runs)
    measured = [run.drive.accelerations for run in runs]
    reach = 1.08 * max(radius, *(np.abs([*a.ax, *a.ay]).max(initial=0.0) for a in measured))
    return radius * np.array([np.cos(angle), np.sin(angle)]), reach


def _mark(ax, run, k, values):
    """Put a dot on the extreme that the metrics report."""
    point = (run.series.station[k], values[k])
    ax.plot(*point, 'o', ms=4.5, color=run.look.colour, mec='white', mew=0.8, zorder=5)


def _along(ax, runs):
    """Show the same stations in every panel."""
    low = min(run.series.station.min() for run in runs)
    high = max(run.series.station.max() for run in runs)
    margin = max(0.02 * (high - low), LEAST_MARGIN_M)
    ax.set(xlim=(low - margin, high + margin), xlabel=STATION)


def note(ax, text):
    """Write a small note above the right corner of a panel."""
    look = {'ha': 'right', 'va': 'bottom', 'fontsize': 7.5, 'color': style.QUIET}
    ax.annotate(
        text, (1.0, 1.0), (0, 7), xycoords='axes fraction', textcoords='offset points', **look
    )


# figures by name, each draws on (ax, runs); the panels of those with another name
FIGURES_OF = {'road_wheel_angle': 'steer', 'longitudinal_force': 'force'}
FIGURES = {
    name: partial(draw_panel, panel=panel)
    for name in ('v2o', 'v2e_left', 'v2e_right', 'velocity', 'sideslip', *FIGURES_OF)
    for panel in PANELS
    if panel.name == FIGURES_OF.get(name, name)
} | {'gg': draw_gg}
