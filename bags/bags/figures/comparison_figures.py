"""Figures of a comparison: one sheet with every panel, and each panel singly; the trajectories.

The trajectories are drawn from above, with edges, coarse path and the unsafe areas of obstacles.
"""

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon

from bags.evaluation import geometry
from bags.evaluation.series import obstacle_position
from bags.figures import overlay, panels, style
from bags.figures.panels import EVERY, note

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


def draw_trajectories(ax, runs):
    """Draw the scene of the first run and the trajectories of all."""
    scene = runs[0].drive.scene
    _edges(ax, scene)
    ax.plot(*scene.reference.T, **style.coarse_path_line())
    for run in runs:
        _path(ax, run)
    for run in _with_outlines(runs):
        _outlines(ax, run)
    for obstacle in scene.obstacles:
        _obstacle(ax, obstacle, runs)
    if any(_moves(obstacle) for obstacle in scene.obstacles):
        _time_labels(ax, runs[0])
    low, high = road_limits(runs)
    stretch = _stretch(high - low)
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel='X [m]', ylabel='Y [m]')
    ax.set_aspect(stretch)
    scale = f', Y drawn {stretch:.0f} times larger than X' if stretch > 1.0 else ''
    legend = ['lines: paths of the centre of gravity']
    if scene.obstacles:
        legend.append('ring: closer to the obstacle than the safety distance, which is penalised')
    if any(_moves(obstacle) for obstacle in scene.obstacles):
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
    near += [_extent(obstacle, drives) for obstacle in scene.obstacles]
    points = np.concatenate(near)
    return points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M


def _extent(obstacle, drives):
    """Return corners (n, 2) around an obstacle wherever it is beside the cars."""
    centres = np.column_stack([obstacle.x, obstacle.y])
    reach = BESIDE_M + obstacle.radius
    low, high = drives.min(axis=0) - reach, drives.max(axis=0) + reach
    centres = centres[((centres > low) & (centres < high)).all(axis=1)]
    return np.concatenate([centres - obstacle.radius, centres + obstacle.radius])


def road_aspect(runs):
    """Return height over width of the drawn panel."""
    low, high = road_limits(runs)
    size = high - low
    return size[1] * _stretch(size) / size[0]


def _stretch(size):
    return STRETCH if size[0] > LONG_ROAD * size[1] else 1.0


def _edges(ax, scene):
    road = np.concatenate([scene.left, scene.right[::-1]])
    ax.add_patch(Polygon(road, facecolor='#F4F4F2', edgecolor='none', zorder=0))
    for edge in (scene.left, scene.right):
        ax.plot(*edge.T, color=style.EDGE, lw=1.6, zorder=2)


def _with_outlines(runs):
    """Return the runs whose cars are drawn: of many the first one of each colour."""
    if len(runs) <= style.MANY:
        return runs
    return {run.look: run for run in reversed(runs)}.values()


def _path(ax, run):
    motion = run.drive.motion
    ax.plot(motion.x[::EVERY], motion.y[::EVERY], zorder=4, **run.line)


def _outlines(ax, run):
    for k in _shown(run):
        box = _box(run, k)
        ax.add_patch(
            Polygon(
                box,
                facecolor=(run.colour, 0.06),
                edgecolor=run.colour,
                ls=run.line['linestyle'],
                lw=CAR_WIDTH * run.look.width,
                zorder=3,
            )
        )


def _shown(run):
    """Return the samples at which the car is drawn."""
    t = run.series.t
    step = max(1, round(OUTLINE_EVERY_S / np.median(np.diff(t)))) if len(t) > 1 else 1
    return range(0, len(run.series.t), step)


def _box(run, k):
    motion = run.drive.motion
    return geometry.outline_corners(
        motion.x[k], motion.y[k], motion.yaw[k], run.drive.facts.outline
    )


def _time_labels(ax, run):
    """Label some outlines of the first car with their times."""
    motion = run.drive.motion
    for k in _timed(run):
        place = motion.x[k], _box(run, k)[:, 1].max()
        _time_label(ax, place, run.series.t[k], run.colour, 'bottom')


def _timed(run):
    """Return the samples of a car whose time is printed, where obstacles move."""
    return _shown(run)[::TIME_EVERY]


def _time_label(ax, place, t, colour, side):
    look = {'fontsize': 7.0, 'color': colour, 'ha': 'center', 'va': side, 'gid': style.TIME_LABEL}
    ax.annotate(
        f'{t:.1f} s',
        place,
        (0, LABEL_ASIDE if side == 'bottom' else -LABEL_ASIDE),
        textcoords='offset points',
        zorder=5,
        annotation_clip=True,
        **look,
    )


def _moves(obstacle):
    return np.nanmax(np.hypot(obstacle.vx, obstacle.vy)) > STILL_MPS


def _obstacle(ax, obstacle, runs):
    """Draw an obstacle with its safety distance; a moving one at the labelled times of the car."""
    run = runs[0]
    facts, scene = run.drive.facts, run.drive.scene
    if not _moves(obstacle):
        for first in np.flatnonzero(np.isfinite(obstacle.x))[:1]:
            _discs(ax, (obstacle.x[first], obstacle.y[first]), obstacle.radius, facts, pale=False)
        return
    timed = np.array(_timed(run))
    x, y = obstacle_position(obstacle, scene, run.drive.motion.stamp_ns[timed])
    for k, *centre in zip(timed, x, y):
        if np.isfinite(centre).all():
            _discs(ax, centre, obstacle.radius, facts, pale=True)
            place = centre[0], centre[1] - obstacle.radius
            _time_label(ax, place, run.series.t[k], style.INK, 'top')
    ax.plot(obstacle.x, obstacle.y, color=style.EDGE, lw=0.8, zorder=2)


def _discs(ax, centre, radius, facts, pale):
    touch = radius + facts.vehicle_radius
    strength = 0.4 if pale else 1.0
    for reach, colour, alpha in (
        (touch + facts.safe_obstacle, style.UNSAFE, 0.22),
        (touch, style.COLLISION, 0.16),
    ):
        ax.add_patch(
            Circle(centre, reach, facecolor=(colour, alpha * strength), edgecolor=colour, lw=0.7)
        )
    ax.add_patch(
        Circle(centre, radius, facecolor=(style.EDGE, strength), edgecolor='none', zorder=3)
    )


# of the sheet, below the trajectories: panels and their relative widths
ROWS = (
    {
        panels.draw_v2o: 15,
        panels.draw_v2e_left: 11,
        panels.draw_v2e_right: 11,
        panels.draw_velocity: 11,
    },
    {panels.draw_sideslip: 12, panels.draw_steer: 12, panels.draw_force: 12, panels.draw_gg: 12},
)
WITH_AREAS = {draw_trajectories, panels.draw_v2o, panels.draw_v2e_left, panels.draw_v2e_right}
NAMES = {
    draw_trajectories: 'trajectories',
    panels.draw_v2o: 'v2o',
    panels.draw_v2e_left: 'v2e_left',
    panels.draw_v2e_right: 'v2e_right',
    panels.draw_velocity: 'velocity',
    panels.draw_sideslip: 'sideslip',
    panels.draw_steer: 'road_wheel_angle',
    panels.draw_force: 'longitudinal_force',
    panels.draw_gg: 'gg',
}


# the signal of each panel against the station
SIGNALS = {
    panels.draw_v2o: 'v2o',
    panels.draw_v2e_left: 'v2e_left',
    panels.draw_v2e_right: 'v2e_right',
    panels.draw_velocity: 'velocity',
    panels.draw_sideslip: 'sideslip',
    panels.draw_steer: 'steer',
    panels.draw_force: 'force',
}
SHEET = 'comparison'
ALL = (SHEET, *NAMES.values())
FREE_SHARE = 0.96  # of the width of a figure, for title and legend
COSTLY = (SHEET, 'trajectories', 'v2o')  # they take about as long as all others


def write_figures(runs, title, folder, names=ALL, overlays=()):
    """Write figures of ALL into `folder` as PNG and SVG: the sheet, and panels."""
    with mpl.rc_context(style.RC):
        for name in ALL:
            if name in names:
                style.save_figure(draw_figure(name, runs, title, overlays), folder / name)


def draw_figure(name, runs, title, overlays=()):
    """Return a figure of ALL, with the overlays: the sheet under a title, or a panel."""
    with mpl.rc_context(style.RC):
        if name == SHEET:
            return _sheet(runs, title, overlays)
        panel = next(panel for panel, known in NAMES.items() if known == name)
        return _single(panel, runs, overlays)


def _sheet(runs, title, overlays):
    top = min(max(SHEET_WIDTH * road_aspect(runs) + 0.5, 2.4), 8.0)
    figure = style.new_sheet((SHEET_WIDTH, top + 8.6), title)
    grid = figure.add_gridspec(1 + len(ROWS), 1, height_ratios=[top, *(3.3 for _ in ROWS)])
    _draw(draw_trajectories, figure.add_subplot(grid[0]), runs, overlays)
    for row, widths in enumerate(ROWS, start=1):
        cells = grid[row].subgridspec(1, len(widths), width_ratios=list(widths.values()))
        for cell, panel in zip(cells, widths):
            _draw(panel, figure.add_subplot(cell), runs, overlays)
    style.letter_panels(figure)
    _legend(figure, runs, WITH_AREAS, overlays)
    return figure


def _draw(panel, ax, runs, overlays):
    """Draw a panel and what the overlays have for it; return those that have something."""
    panel(ax, runs)
    return [overlay_run for overlay_run in overlays if _draw_overlay(panel, ax, overlay_run)]


def _draw_overlay(panel, ax, overlay_run):
    curve = _overlay_curve(panel, overlay_run)
    if curve is None or not np.isfinite(curve).all(axis=1).any():
        return False
    limits = ax.get_xlim(), ax.get_ylim()
    ax.plot(*curve.T, zorder=4.5, **overlay_run.look.line)
    ax.set(xlim=limits[0], ylim=limits[1])
    if panel in SIGNALS and panel not in WITH_AREAS:
        low, high = limits[1]
        ax.set_ylim(min(low, np.nanmin(curve[:, 1])), max(high, np.nanmax(curve[:, 1])))
    return True


def _overlay_curve(panel, overlay_run):
    """Return the points (n, 2) of an overlay in a panel; None where it has none."""
    if panel is draw_trajectories:
        return overlay_run.path()
    if panel is panels.draw_gg:
        known = 'lateral' in overlay_run.signals and 'gg_x' in overlay_run.signals
        return (
            np.column_stack([overlay_run.signals['lateral'], overlay_run.signals['gg_x']])
            if known
            else None
        )
    station, values = overlay_run.along(overlay.STATION), overlay_run.signals.get(SIGNALS[panel])
    return None if station is None or values is None else np.column_stack([station, values])


def _single(panel, runs, overlays=()):
    size = PANEL_SIZE
    if panel is draw_trajectories:
        size = (SHEET_WIDTH, min(max(SHEET_WIDTH * road_aspect(runs) + 1.2, 3.0), SHEET_WIDTH))
    figure = Figure(figsize=size, layout='constrained')
    shown = _draw(panel, figure.add_subplot(), runs, overlays)
    _legend(figure, runs, (panel,), shown)
    return figure


def _legend(figure, runs, drawn, overlays):
    """Put a legend of the runs, and of the marks in the panels, above them."""
    looks = panels.legend_looks(runs)
    keys = [Line2D([], [], label=label, **look.line) for label, look in looks.items()]
    keys += [
        Line2D([], [], label=overlay_run.name, **overlay_run.look.line) for overlay_run in overlays
    ]
    if draw_trajectories in drawn:
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
