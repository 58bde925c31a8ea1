"""Figures of a comparison: one sheet with every panel, and each panel singly; the trajectories.

The trajectories are drawn from above, with edges, coarse path and the unsafe areas of obstacles.
"""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon

from bags.errors import BagError
from bags.evaluation import geometry
from bags.evaluation.drive import obstacle_position
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.figures import overlay, panels, style
from bags.figures.overlay import Overlay
from bags.figures.panels import EVERY, note
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
PANELS = {TRAJECTORIES: draw_trajectories, **panels.FIGURES}
# of the sheet, below the trajectories: panels and their relative widths
ROWS = (
    {'v2o': 15, 'v2e_left': 11, 'v2e_right': 11, 'velocity': 11},
    {'sideslip': 12, 'road_wheel_angle': 12, 'longitudinal_force': 12, 'gg': 12},
)
WITH_AREAS = {TRAJECTORIES, 'v2o', 'v2e_left', 'v2e_right'}
ALL = (SHEET, *PANELS)
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
    PANELS[name](ax, runs)
    shown = []
    for laid in overlays:
        across, signal = laid.axes.get(overlay.STATION), panels.FIGURES_OF.get(name, name)
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
