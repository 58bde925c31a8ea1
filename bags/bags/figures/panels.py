"""The panels of a comparison against the station: each draws every run on one pair of axes.

They follow the paper's double-lane-change figure: distances to edges and obstacles, velocity,
sideslip angle, road-wheel angle, longitudinal force, and the G-G diagram, under its captions. In
the panel of the distances to obstacles the closest approaches are enlarged.
"""

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from functools import partial

import numpy as np

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
# of a vertical axis, by signal: noise is not to fill it, and 0.1 m/s not to look like braking
LEAST_SPANS = {
    'velocity': 5.0,  # m/s
    'sideslip': 2.0,  # deg
    'contouring': 0.5,  # m
    'lateral': 2.0,  # m/s^2
    'steer': 2.0,  # deg
    'force': 2.0,  # kN
}
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


def assign(runs: Mapping[str, EvaluatedDrive]) -> list[EvaluatedDrive]:
    """Return runs by name in their order, each with this name and its look."""
    looks = style.assign_looks(list(runs), [controller_of(run) for run in runs.values()])
    named = {name: copy(run) for name, run in runs.items()}
    for name, run in named.items():
        run.name, run.look = name, looks[name]
    return list(named.values())


def controller_of(run: EvaluatedDrive) -> str:
    """Return the controller of a run without the label of the variant."""
    return run.drive.facts.controller.partition('@')[0]


def legend_looks(runs: Sequence[EvaluatedDrive]) -> dict[str, style.Look]:
    """Return {label: Look} of the legend of runs."""
    return style.legend_looks({run.name: run.look for run in runs}, list(map(controller_of, runs)))


# of a run: stamps (n,) [ns] and values (n,)
SIGNALS = {
    'velocity': lambda run: (run.drive.motion.stamp_ns, run.drive.motion.vx),
    'sideslip': lambda run: (run.drive.motion.stamp_ns, np.degrees(run.series.sideslip)),
    'contouring': lambda run: (run.drive.motion.stamp_ns, run.series.contouring),
    'lateral': lambda run: (run.drive.accelerations.stamp_ns, run.drive.accelerations.ay),
    'steer': lambda run: (run.drive.inputs.stamp_ns, np.degrees(run.drive.inputs.steer)),
    'force': lambda run: (run.drive.inputs.stamp_ns, run.drive.inputs.force / KILO),
}


def axis_limits(name: str, columns: Iterable[np.ndarray]) -> tuple[float, float]:
    """Return the limits of the vertical axis of a signal: its values, or its LEAST_SPANS."""
    finite = [column[np.isfinite(column)] for column in columns]
    values = np.concatenate([np.empty(0), *finite])
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    half = max((0.5 + SPARE) * (high - low), LEAST_SPANS[name] / 2)
    return (low + high) / 2 - half, (low + high) / 2 + half


def draw_v2e(ax, runs: Sequence[EvaluatedDrive], side: str) -> None:
    """Draw the distance between the vehicle circle and the road edge of a side (D_V2E)."""
    safe, far = max(run.drive.facts.safe_edge for run in runs), f'{side} edge beyond {FAR_M:g} m'
    _draw_distances(ax, runs, lambda run: [run.series.v2e[side]], safe, far)
    ax.set(ylabel='$D_{V2E}$ [m]', title=f'Vehicle-to-edge distance, {side}')


def draw_v2o(ax, runs):
    """Draw the distance between the vehicle circle and each obstacle (D_V2O)."""
    safe = max(run.drive.facts.safe_obstacle for run in runs)
    far = f'no obstacle within {FAR_M:g} m'
    _draw_distances(ax, runs, lambda run: run.series.v2o.values(), safe, far)
    draw_insets(ax, runs)
    ax.set(ylabel='$D_{V2O}$ [m]', title='Vehicle-to-obstacle distance')


def _draw_distances(ax, runs, gaps_of, safe, far):
    """Draw gaps (n,) of each run with their smallest values; `far` says that all are large.

    The unsafe area is shaded; small distances are shown, and half a metre below the smallest.
    """
    low, near = 0.0, False
    for run in runs:
        for gap in gaps_of(run):
            _curve(ax, run, np.where(gap < 2 * FAR_M, gap, np.nan))
            if np.any(gap < FAR_M):
                _mark(ax, run, np.nanargmin(gap), gap)
                low, near = min(low, np.nanmin(gap)), True
    if not near:
        ax.text(0.5, 0.6, far, transform=ax.transAxes, ha='center', color=style.QUIET)
    shade_unsafe(ax, safe)
    ax.set_ylim(low - 0.5, FAR_M)
    _along(ax, runs)


def draw_signal(ax, runs: Sequence[EvaluatedDrive], name: str, ylabel: str, title: str) -> None:
    """Draw a signal of SIGNALS, with the largest sideslip angle and the zero of the force."""
    for run in runs:
        stamp_ns, values = (column[::EVERY] for column in SIGNALS[name](run))
        ax.plot(run.station_at(stamp_ns), values, **run.look.line)
    _along(ax, runs)
    ax.set_ylim(axis_limits(name, [SIGNALS[name](run)[1] for run in runs]))
    ax.set(ylabel=ylabel, title=title)
    if name == 'force':
        ax.axhline(0.0, color=style.EDGE, lw=0.6, zorder=1)
    for run in runs if name == 'sideslip' else ():
        _, angle = SIGNALS[name](run)
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


def _curve(ax, run, values):
    ax.plot(run.series.station[::EVERY], values[::EVERY], **run.look.line)


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


def _signal(name, ylabel, title):
    return partial(draw_signal, name=name, ylabel=ylabel, title=title)


# against the station, by name: each draws on (ax, runs)
PANELS = {
    'v2o': draw_v2o,
    'v2e_left': partial(draw_v2e, side='left'),
    'v2e_right': partial(draw_v2e, side='right'),
    'velocity': _signal('velocity', '$v_x$ [m/s]', 'Longitudinal velocity'),
    'sideslip': _signal('sideslip', '$\\beta$ [deg]', 'Vehicle sideslip angle'),
    'road_wheel_angle': _signal('steer', '$\\delta$ [deg]', 'Road-wheel angle'),
    'longitudinal_force': _signal(
        'force', '$F_x$ [kN], braking negative', 'Longitudinal force input'
    ),
    'gg': draw_gg,
}
