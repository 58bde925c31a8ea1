"""Figures of a comparison: one sheet with every panel, and each panel singly; the trajectories.

A panel shows every run on one pair of axes. They follow the paper's double-lane-change figure:
distances to edges and obstacles, velocity, sideslip angle, road-wheel angle, longitudinal force,
and the G-G diagram, under its captions; the page has more of them. In a figure they are against the
station, and the closest approaches to obstacles are enlarged. The trajectories are drawn from
above, with edges, coarse path and the unsafe areas of obstacles.
"""

import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon
from matplotlib.ticker import MaxNLocator

from bags.errors import BagError
from bags.evaluation import geometry
from bags.evaluation.drive import WHY, obstacle_position, report_numbers
from bags.evaluation.metrics.driving import GRAVITY
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.figures import overlay, style
from bags.figures.overlay import Overlay
from bags.figures.scene import car_shapes, obstacle_shapes, road_shapes
from msgs_yaml.strict_yaml import closest

SHEET_WIDTH = 15.0  # inch
PANEL_SIZE = (7.0, 4.2)  # inch
OUTLINE_EVERY_S = 0.6
TIME_EVERY = 2  # where obstacles move, they and one in this many outlines are drawn with a time
LONG_ROAD = 6.0  # length over width from which the lateral direction is drawn larger
STRETCH = 3.0
CAR_WIDTH = 0.5  # of an outline, share of the width of the curves
MARGIN_M = 1.0
BESIDE_M = 5.0  # of a car, where an obstacle is drawn as a whole
STILL_MPS = 0.05
LABEL_ASIDE = 1.5  # points
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


def draw_trajectories(ax, runs: Sequence[EvaluatedDrive]) -> None:
    """Draw the scene of the first run and the trajectories of all."""
    first, scene = runs[0], runs[0].drive.scene
    for shape in road_shapes(scene.left, scene.right, 0.0):
        if shape.kind == 'road':
            ax.add_patch(Polygon(shape.points, facecolor='#F4F4F2', edgecolor='none', zorder=0))
        elif shape.kind == 'edge':
            ax.plot(*shape.points.T, color=style.EDGE, lw=1.6, zorder=2)
    ax.plot(*scene.reference.T, **style.coarse_path_line())
    for run in runs:
        motion = run.drive.motion
        ax.plot(motion.x[::EVERY], motion.y[::EVERY], zorder=4, **run.look.line)
    # of many runs the car of the first one of each colour
    many = len(runs) > style.MANY
    for run in {run.look: run for run in reversed(runs)}.values() if many else runs:
        look = {'edgecolor': run.look.colour, 'ls': run.look.line['linestyle'], 'zorder': 3}
        for k in _shown(run):
            box = Polygon(_box(run, k), facecolor=(run.look.colour, 0.06), **look)
            box.set_linewidth(CAR_WIDTH * run.look.width)
            ax.add_patch(box)
    moving = {o.id for o in scene.obstacles if np.nanmax(np.hypot(o.vx, o.vy)) > STILL_MPS}
    timed, facts = _shown(first)[::TIME_EVERY], first.drive.facts
    for obstacle in scene.obstacles:
        if obstacle.id not in moving:
            for k in np.flatnonzero(np.isfinite(obstacle.x))[:1]:
                _discs(ax, (obstacle.x[k], obstacle.y[k]), obstacle.radius, facts, 1.0)
            continue
        # its way, and itself at the labelled times of the car
        places = obstacle_position(obstacle, scene, first.stamp_ns[np.array(timed)])
        for k, x, y in zip(timed, *places):
            if np.isfinite([x, y]).all():
                _discs(ax, (x, y), obstacle.radius, facts, 0.4)
                if not obstacle.disc:
                    place = x, y - obstacle.radius
                    _time_label(ax, place, first.series.t[k], style.INK, 'top')
        ax.plot(obstacle.x, obstacle.y, color=style.EDGE, lw=0.8, zorder=2)
    for k in timed if moving else ():
        place = first.drive.motion.x[k], _box(first, k)[:, 1].max()
        _time_label(ax, place, first.series.t[k], first.look.colour, 'bottom')
    low, high = road_limits(runs)
    stretch = _stretch(high - low)
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel='X [m]', ylabel='Y [m]')
    ax.set_aspect(stretch)
    scale = f', Y drawn {stretch:.0f} times larger than X' if stretch > 1.0 else ''
    legend = ['lines: paths of the centre of gravity']
    if scene.obstacles:
        legend.append('ring: closer to the obstacle than the safety distance, which is penalised')
    if moving:
        legend.append('same number: same moment')
    note(ax, '; '.join(legend))
    ax.set_title(f'Vehicle trajectories{scale}')


def road_limits(runs):
    """Return the lower left and upper right corner (2,) [m] of the part of the road to draw."""
    seen = [np.column_stack([run.drive.motion.x, run.drive.motion.y]) for run in runs]
    drives = np.concatenate(seen)
    scene = runs[0].drive.scene
    near = [drives, *(_box(run, k) for run in runs for k in _shown(run))]
    for edge in (scene.left, scene.right):
        along = geometry.project_drive(drives[:: 10 * EVERY], edge, np.inf).distance
        reach = np.linspace(along.min(), along.max(), 200)
        vertex = geometry.arc_length(edge)
        near.append(np.column_stack([np.interp(reach, vertex, axis) for axis in edge.T]))
    for obstacle in scene.obstacles:  # wherever it is beside the cars
        centres, reach = np.column_stack([obstacle.x, obstacle.y]), BESIDE_M + obstacle.radius
        lowest, highest = drives.min(axis=0) - reach, drives.max(axis=0) + reach
        centres = centres[((centres > lowest) & (centres < highest)).all(axis=1)]
        near += [centres - obstacle.radius, centres + obstacle.radius]
    points = np.concatenate(near)
    return points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M


def road_aspect(runs):
    """Return height over width of the drawn panel."""
    low, high = road_limits(runs)
    size = high - low
    return size[1] * _stretch(size) / size[0]


def _stretch(size):
    return STRETCH if size[0] > LONG_ROAD * size[1] else 1.0


def _shown(run):
    """Return the samples at which the car is drawn."""
    t = run.series.t
    step = max(1, round(OUTLINE_EVERY_S / np.median(np.diff(t)))) if len(t) > 1 else 1
    return range(0, len(run.series.t), step)


def _box(run, k):
    motion = run.drive.motion
    pose = motion.x[k], motion.y[k], motion.yaw[k]
    return car_shapes(*pose, run.drive.facts.outline)[0].points


def _time_label(ax, place, t, colour, side):
    look = {'fontsize': 7.0, 'color': colour, 'ha': 'center', 'va': side, 'gid': style.TIME_LABEL}
    look |= {'zorder': 5, 'annotation_clip': True, 'textcoords': 'offset points'}
    aside = LABEL_ASIDE if side == 'bottom' else -LABEL_ASIDE
    ax.annotate(f'{t:.1f} s', place, (0, aside), **look)


def _discs(ax, centre, radius, facts, strength):
    looks = {
        'unsafe': {'facecolor': (style.UNSAFE, 0.22 * strength), 'edgecolor': style.UNSAFE},
        'touch': {'facecolor': (style.COLLISION, 0.16 * strength), 'edgecolor': style.COLLISION},
        'obstacle': {'facecolor': (style.EDGE, strength), 'edgecolor': 'none', 'zorder': 3},
    }
    for disc in obstacle_shapes(0, centre, radius, facts.vehicle_radius, facts.safe_obstacle):
        ax.add_patch(Circle(tuple(disc.points), disc.radius, lw=0.7, **looks[disc.kind]))


SHEET, TRAJECTORIES = 'comparison', 'trajectories'
FIGURES_OF = {'road_wheel_angle': 'steer', 'longitudinal_force': 'force'}
# by name, each draws on (ax, runs); FIGURES_OF has the panels of those with another name
FIGURES = {
    TRAJECTORIES: draw_trajectories,
    **{
        name: partial(draw_panel, panel=panel)
        for name in ('v2o', 'v2e_left', 'v2e_right', 'velocity', 'sideslip', *FIGURES_OF)
        for panel in PANELS
        if panel.name == FIGURES_OF.get(name, name)
    },
    'gg': draw_gg,
}
# of the sheet, below the trajectories: panels and their relative widths
ROWS = (
    {'v2o': 15, 'v2e_left': 11, 'v2e_right': 11, 'velocity': 11},
    {'sideslip': 12, 'road_wheel_angle': 12, 'longitudinal_force': 12, 'gg': 12},
)
WITH_AREAS = {TRAJECTORIES, 'v2o', 'v2e_left', 'v2e_right'}
ALL = (SHEET, *FIGURES)
FREE_SHARE = 0.96  # of the width of a figure, for title and legend


def write_figures(
    runs: Sequence[EvaluatedDrive],
    title: str,
    folder: Path,
    overlays: Sequence[Overlay] = (),
    singly: bool = False,
) -> list[Path]:
    """Write the sheet into `folder` as PNG; return the paths.

    With `singly` all of ALL as PNG and SVG. Without it those that an earlier comparison wrote there
    are removed: they would show other runs than the sheet.
    """
    written = []
    with mpl.rc_context(style.RC):
        for name in ALL if singly else (SHEET,):
            suffixes = style.SUFFIXES if singly else style.SUFFIXES[:1]
            figure = draw_figure(name, runs, title, overlays)
            written += style.save_figure(figure, folder / name, suffixes)
    for path in (path for name in ALL for path in style.figure_paths(folder / name)):
        if path not in written:
            path.unlink(missing_ok=True)
    return written


def draw_figure(
    name: str, runs: Sequence[EvaluatedDrive], title: str, overlays: Sequence[Overlay] = ()
) -> Figure:
    """Return a figure of ALL, with the overlays: the sheet under a title, or a panel."""
    with mpl.rc_context(style.RC):
        if name != SHEET:
            size = PANEL_SIZE
            if name == TRAJECTORIES:
                height = SHEET_WIDTH * road_aspect(runs) + 1.2
                size = SHEET_WIDTH, min(max(height, 3.0), SHEET_WIDTH)
            figure = Figure(figsize=size, layout='constrained')
            shown = _draw(name, figure.add_subplot(), runs, overlays)
            _legend(figure, runs, (name,), shown)
            return figure
        top = min(max(SHEET_WIDTH * road_aspect(runs) + 0.5, 2.4), 8.0)
        figure = style.new_sheet((SHEET_WIDTH, top + 8.6), title)
        grid = figure.add_gridspec(1 + len(ROWS), 1, height_ratios=[top, *(3.3 for _ in ROWS)])
        _draw(TRAJECTORIES, figure.add_subplot(grid[0]), runs, overlays)
        for row, widths in enumerate(ROWS, start=1):
            cells = grid[row].subgridspec(1, len(widths), width_ratios=list(widths.values()))
            for cell, panel in zip(cells, widths):
                _draw(panel, figure.add_subplot(cell), runs, overlays)
        style.letter_panels(figure)
        _legend(figure, runs, WITH_AREAS, overlays)
        return figure


def drawn_runs(runs: Mapping[str, EvaluatedDrive]) -> list[EvaluatedDrive]:
    """Return runs by label as the figures take them, each with its look.

    Raises BagError for runs of different scenarios: there is one road in a figure.
    """
    scenarios = list(dict.fromkeys(run.drive.facts.scenario for run in runs.values()))
    if len(scenarios) > 1:
        listed = ', '.join(map(repr, scenarios))
        raise BagError(f'a figure shows one scenario, the runs drove {listed}: choose runs of one')
    return style.assign(runs)


def draw(runs: Mapping[str, EvaluatedDrive], name: str) -> Figure:
    """Return a figure of ALL of runs by label, as a notebook shows it. Raises BagError."""
    if name not in ALL:
        raise BagError(f'no figure {name!r}{closest(name, ALL)}; there are {", ".join(ALL)}')
    drawn = drawn_runs(runs)
    with mpl.rc_context(style.RC):
        figure = draw_figure(name, drawn, drawn[0].drive.facts.scenario)
        # ticks take their look from the style when they are first laid out
        figure.draw_without_rendering()
        style.hide_overlapping(figure)

    def as_png():
        stream = io.BytesIO()
        figure.savefig(stream, format='png')
        return stream.getvalue()

    # also where pyplot was never imported
    figure._repr_png_ = as_png
    return figure


def _draw(name, ax, runs, overlays):
    """Draw a panel and what the overlays have for it; return those that have something."""
    FIGURES[name](ax, runs)
    shown = []
    for laid in overlays:
        across, signal = laid.axes.get(overlay.STATION), FIGURES_OF.get(name, name)
        if name == 'gg':
            across, signal = laid.signals.get('lateral'), 'gg_x'
        values = laid.signals.get(signal)
        curve = laid.path()
        if name != TRAJECTORIES:
            is_known = across is not None and values is not None
            curve = np.column_stack([across, values]) if is_known else None
        if curve is None or not np.isfinite(curve).all(axis=1).any():
            continue
        shown.append(laid)
        limits = ax.get_xlim(), ax.get_ylim()
        ax.plot(*curve.T, zorder=4.5, **laid.look.line)
        ax.set(xlim=limits[0], ylim=limits[1])
        if name not in WITH_AREAS and name != 'gg':
            low, high = limits[1]
            ax.set_ylim(min(low, np.nanmin(curve[:, 1])), max(high, np.nanmax(curve[:, 1])))
    return shown


def _legend(figure, runs, drawn, overlays):
    """Put a legend of the runs, and of the marks in the panels, above them."""
    looks = style.legend_looks(runs)
    keys = [Line2D([], [], label=label, **look.line) for label, look in looks.items()]
    keys += [Line2D([], [], label=laid.name, **laid.look.line) for laid in overlays]
    if TRAJECTORIES in drawn:
        keys.append(Line2D([], [], label='coarse path', **style.coarse_path_line()))
    if not WITH_AREAS.isdisjoint(drawn):
        for colour, label in style.AREAS.items():
            keys.append(Line2D([], [], color=colour, lw=7, alpha=0.35, label=label))
    renderer = FigureCanvasAgg(figure).get_renderer()
    titles = sum(text.get_window_extent(renderer).width for text in figure.texts)
    free = FREE_SHARE * figure.bbox.width - titles
    # names of controllers may be long: as many rows as it takes
    for columns in range(len(keys), 0, -1):
        legend = figure.legend(
            handles=keys, loc='outside upper right', handlelength=3.4, ncols=columns
        )
        if columns == 1 or legend.get_window_extent(renderer).width <= free:
            return
        legend.remove()
