"""The road from above: edges, coarse path, obstacles with their unsafe area, and every drive."""

import numpy as np
from matplotlib.patches import Circle, Polygon

from bags.pictures import palette
from bags.pictures.panels import EVERY, note
from bags.verdict import geometry
from msgs_yaml.stamp import NS_PER_S

OUTLINE_EVERY_S = 0.6
TIME_EVERY = 2  # of the outlines one in this many is given its time, where obstacles move
TRAIL_RADII = 8.0  # between two drawn places of a moving obstacle
LONG_ROAD = 6.0  # length over width from which the lateral direction is drawn larger
STRETCH = 3.0
MARGIN_M = 1.0
STILL_MPS = 0.05


def trajectories(ax, runs):
    """Draw the scene of the first run and the trajectories of all."""
    scene = runs[0].drive.scene
    _edges(ax, scene)
    ax.plot(*scene.reference.T, color=palette.REFERENCE, lw=1.0, ls=(0, (6, 3)), zorder=2)
    for run in runs:
        _vehicle(ax, run)
    for obstacle in scene.obstacles:
        _obstacle(ax, obstacle, runs)
    if any(_moves(obstacle) for obstacle in scene.obstacles):
        _clock(ax, runs[0])
    low, high = view(runs)
    stretch = _stretch(high - low)
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel='X [m]', ylabel='Y [m]')
    ax.set_aspect(stretch)
    scale = f', lateral scale × {stretch:.0f}' if stretch > 1.0 else ''
    if scene.obstacles:
        note(ax, 'lines: centre of gravity; shaded: where it must not be')
    ax.set_title(f'Vehicle trajectories{scale}')


def view(runs):
    """Return the lower left and upper right corner (2,) [m] of what the drives saw."""
    seen = [np.column_stack([run.drive.motion.x, run.drive.motion.y]) for run in runs]
    drives = np.concatenate(seen)
    scene = runs[0].drive.scene
    near = [drives, *(_box(run, k) for run in runs for k in _shown(run))]
    for edge in (scene.left, scene.right):
        along = geometry.track(drives[:: 10 * EVERY], edge, np.inf).distance
        reach = np.linspace(along.min(), along.max(), 200)
        vertex = geometry.arc_length(edge)
        near.append(np.column_stack([np.interp(reach, vertex, axis) for axis in edge.T]))
    points = np.concatenate(near)
    return points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M


def shape(runs):
    """Return height over width of the drawn panel."""
    low, high = view(runs)
    size = high - low
    return size[1] * _stretch(size) / size[0]


def _stretch(size):
    return STRETCH if size[0] > LONG_ROAD * size[1] else 1.0


def _edges(ax, scene):
    road = np.concatenate([scene.left, scene.right[::-1]])
    ax.add_patch(Polygon(road, facecolor='#F4F4F2', edgecolor='none', zorder=0))
    for edge in (scene.left, scene.right):
        ax.plot(*edge.T, color=palette.EDGE, lw=1.6, zorder=2)


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
    return geometry.corners(motion.x[k], motion.y[k], motion.yaw[k], run.drive.facts.outline)


def _clock(ax, run):
    """Say when the first car was where, at some of its places."""
    motion = run.drive.motion
    for k in _shown(run)[::TIME_EVERY]:
        _time(ax, (motion.x[k], _box(run, k)[:, 1].max()), run.series.t[k], run.colour, 'bottom')


def _time(ax, place, t, colour, side):
    look = {'fontsize': 7.0, 'color': colour, 'ha': 'center', 'va': side}
    ax.text(*place, f'{t:.1f} s', zorder=5, clip_on=True, **look)


def _moves(obstacle):
    return np.nanmax(np.hypot(obstacle.vx, obstacle.vy)) > STILL_MPS


def _obstacle(ax, obstacle, runs):
    """Draw an obstacle with the area the centre of gravity must keep out of; a trail if moving."""
    seen = np.flatnonzero(np.isfinite(obstacle.x))
    moves = _moves(obstacle)
    drive = runs[0].drive
    for k in _apart(obstacle, seen) if moves else seen[:1]:
        _discs(ax, (obstacle.x[k], obstacle.y[k]), obstacle.radius, drive.facts, pale=moves)
        if moves:
            t = (drive.scene.obstacle_stamp_ns[k] - drive.motion.stamp_ns[0]) / NS_PER_S
            _time(ax, (obstacle.x[k], obstacle.y[k] - obstacle.radius), t, palette.INK, 'top')
    if moves:
        ax.plot(obstacle.x, obstacle.y, color=palette.EDGE, lw=0.8, ls=':', zorder=2)


def _apart(obstacle, seen):
    """Return those of the messages `seen` between which the obstacle has moved on far enough."""
    steps = np.hypot(np.diff(obstacle.x[seen]), np.diff(obstacle.y[seen]))
    laps = np.concatenate([[0.0], np.cumsum(steps)]) // (TRAIL_RADII * obstacle.radius)
    return seen[np.flatnonzero(np.diff(laps, prepend=-1.0) > 0.0)]


def _discs(ax, centre, radius, facts, pale):
    touch = radius + facts.vehicle_radius
    strength = 0.4 if pale else 1.0
    for reach, colour, alpha in (
        (touch + facts.safe_obstacle, palette.UNSAFE, 0.22),
        (touch, palette.COLLISION, 0.16),
    ):
        ax.add_patch(
            Circle(centre, reach, facecolor=(colour, alpha * strength), edgecolor=colour, lw=0.7)
        )
    ax.add_patch(
        Circle(centre, radius, facecolor=(palette.EDGE, strength), edgecolor='none', zorder=3)
    )
