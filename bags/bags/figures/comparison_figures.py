"""Figures of a comparison: one sheet with every panel, and each panel singly; the trajectories.

The trajectories are drawn from above, with edges, coarse path and the unsafe areas of obstacles.
"""

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon

from bags.evaluation import geometry
from bags.figures import panels, style
from bags.figures.panels import EVERY, note
from msgs_yaml.conversions import NS_PER_S

SHEET_WIDTH = 15.0  # inch
PANEL_SIZE = (7.0, 4.2)  # inch
OUTLINE_EVERY_S = 0.6
TIME_EVERY = 2  # of the outlines one in this many is labelled with its time, where obstacles move
TRAIL_RADII = 8.0  # between two drawn positions of a moving obstacle
LONG_ROAD = 6.0  # length over width from which the lateral direction is drawn larger
STRETCH = 3.0
MARGIN_M = 1.0
STILL_MPS = 0.05


def draw_trajectories(ax, runs):
    """Draw the scene of the first run and the trajectories of all."""
    scene = runs[0].drive.scene
    _edges(ax, scene)
    ax.plot(*scene.reference.T, color=style.REFERENCE, lw=1.0, ls=(0, (6, 3)), zorder=2)
    for run in runs:
        _vehicle(ax, run)
    for obstacle in scene.obstacles:
        _obstacle(ax, obstacle, runs)
    if any(_moves(obstacle) for obstacle in scene.obstacles):
        _time_labels(ax, runs[0])
    low, high = road_limits(runs)
    stretch = _stretch(high - low)
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel='X [m]', ylabel='Y [m]')
    ax.set_aspect(stretch)
    scale = f', lateral scale × {stretch:.0f}' if stretch > 1.0 else ''
    if scene.obstacles:
        note(ax, 'lines: centre of gravity; shaded: where it must not be')
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
    points = np.concatenate(near)
    return points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M


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


def _vehicle(ax, run):
    motion = run.drive.motion
    ax.plot(motion.x[::EVERY], motion.y[::EVERY], zorder=4, **run.line)
    for k in _shown(run):
        box = _box(run, k)
        ax.add_patch(
            Polygon(
                box, facecolor=(run.colour, 0.10), edgecolor=(run.colour, 0.65), lw=0.8, zorder=3
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
    for k in _shown(run)[::TIME_EVERY]:
        _time_label(
            ax, (motion.x[k], _box(run, k)[:, 1].max()), run.series.t[k], run.colour, 'bottom'
        )


def _time_label(ax, place, t, colour, side):
    look = {'fontsize': 7.0, 'color': colour, 'ha': 'center', 'va': side}
    ax.text(*place, f'{t:.1f} s', zorder=5, clip_on=True, **look)


def _moves(obstacle):
    return np.nanmax(np.hypot(obstacle.vx, obstacle.vy)) > STILL_MPS


def _obstacle(ax, obstacle, runs):
    """Draw an obstacle with the area that the centre of gravity must avoid; a trail if moving."""
    seen = np.flatnonzero(np.isfinite(obstacle.x))
    moves = _moves(obstacle)
    drive = runs[0].drive
    for k in _apart(obstacle, seen) if moves else seen[:1]:
        _discs(ax, (obstacle.x[k], obstacle.y[k]), obstacle.radius, drive.facts, pale=moves)
        if moves:
            t = (drive.scene.obstacle_stamp_ns[k] - drive.motion.stamp_ns[0]) / NS_PER_S
            _time_label(ax, (obstacle.x[k], obstacle.y[k] - obstacle.radius), t, style.INK, 'top')
    if moves:
        ax.plot(obstacle.x, obstacle.y, color=style.EDGE, lw=0.8, ls=':', zorder=2)


def _apart(obstacle, seen):
    """Return those of the messages `seen` that are TRAIL_RADII apart."""
    steps = np.hypot(np.diff(obstacle.x[seen]), np.diff(obstacle.y[seen]))
    laps = np.concatenate([[0.0], np.cumsum(steps)]) // (TRAIL_RADII * obstacle.radius)
    return seen[np.flatnonzero(np.diff(laps, prepend=-1.0) > 0.0)]


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


MIDDLE_ROW = (panels.draw_v2e, panels.draw_v2o, panels.draw_velocity)
LAST_ROW = (panels.draw_sideslip, panels.draw_steer, panels.draw_force, panels.draw_gg)
WITH_AREAS = {draw_trajectories, panels.draw_v2e, panels.draw_v2o}
NAMES = {
    draw_trajectories: 'trajectories',
    panels.draw_v2e: 'v2e',
    panels.draw_v2o: 'v2o',
    panels.draw_velocity: 'velocity',
    panels.draw_sideslip: 'sideslip',
    panels.draw_steer: 'road_wheel_angle',
    panels.draw_force: 'longitudinal_force',
    panels.draw_gg: 'gg',
}


SHEET = 'comparison'
ALL = (SHEET, *NAMES.values())
COSTLY = (SHEET, 'trajectories', 'v2o')  # they take about as long as all others


def write_figures(runs, title, folder, names=ALL):
    """Write figures of ALL into `folder` as PNG and SVG: the sheet, and panels."""
    with mpl.rc_context(style.RC):
        for name in ALL:
            if name in names:
                style.save_figure(draw_figure(name, runs, title), folder / name)


def draw_figure(name, runs, title):
    """Return a figure of ALL: the sheet under a title, or a panel."""
    with mpl.rc_context(style.RC):
        if name == SHEET:
            return _sheet(runs, title)
        return _single(next(panel for panel, known in NAMES.items() if known == name), runs)


def _sheet(runs, title):
    top = min(max(SHEET_WIDTH * road_aspect(runs) + 0.5, 2.4), 8.0)
    figure = style.new_sheet((SHEET_WIDTH, top + 8.6), title)
    grid = figure.add_gridspec(3, 12, height_ratios=[top, 3.3, 3.3])
    draw_trajectories(figure.add_subplot(grid[0, :]), runs)
    for row, drawn in ((1, MIDDLE_ROW), (2, LAST_ROW)):
        width = 12 // len(drawn)
        for k, panel in enumerate(drawn):
            panel(figure.add_subplot(grid[row, k * width : (k + 1) * width]), runs)
    style.letter_panels(figure)
    _legend(figure, runs, (draw_trajectories, panels.draw_v2e))
    return figure


def _single(panel, runs):
    size = PANEL_SIZE
    if panel is draw_trajectories:
        size = (SHEET_WIDTH, min(max(SHEET_WIDTH * road_aspect(runs) + 1.2, 3.0), SHEET_WIDTH))
    figure = Figure(figsize=size, layout='constrained')
    panel(figure.add_subplot(), runs)
    _legend(figure, runs, (panel,))
    return figure


def _legend(figure, runs, drawn):
    """Put a legend of the runs, and of the marks in the panels, above them."""
    keys = [Line2D([], [], label=run.name, lw=2.4, **run.line) for run in runs]
    if draw_trajectories in drawn:
        look = {'color': style.REFERENCE, 'lw': 1.0, 'ls': (0, (6, 3))}
        keys.append(Line2D([], [], label='coarse path', **look))
    if not WITH_AREAS.isdisjoint(drawn):
        for colour, label in ((style.UNSAFE, 'unsafe area'), (style.COLLISION, 'collision')):
            keys.append(Line2D([], [], color=colour, lw=7, alpha=0.35, label=label))
    figure.legend(handles=keys, loc='outside upper right', ncols=len(keys), handlelength=2.2)
