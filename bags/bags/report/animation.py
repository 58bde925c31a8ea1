"""The animation of the manoeuvre: cars, plans and obstacles in each frame, drawn on the road.

Positions are in the frame map [m], angles in rad, times in seconds since the first state of a run.
The script of the page only looks up these numbers and rotates the outline.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool, Range1d
from bokeh.plotting import figure

from bags.evaluation import geometry
from bags.evaluation.controller_log import ControllerLog
from bags.evaluation.drive import Scene
from bags.evaluation.series import obstacle_position
from bags.figures import comparison_figures, style
from bags.figures.overlay import Overlay
from bags.figures.panels import Run
from bags.report.interactive_panels import (
    BINS,
    decimate,
    float32,
    line_look,
    new_figure,
    tag_run,
)
from msgs_yaml.conversions import NS_PER_S

FRAME_NS = 20_000_000
STAGE_EVERY = 2  # of the stages of a plan one in this many is drawn
HEIGHTS = (240, 620)  # CSS pixels
FLAG_HEIGHT = 18  # CSS pixels of a row above the road for the name of a car, at most MANY
WIDTH = 1100  # CSS pixels, of the page on a desktop


def frame_times(runs: Sequence[Run]) -> np.ndarray:
    """Return the times of the frames [s], from 0 to the end of the longest run."""
    longest = max(int(np.ptp(run.drive.motion.stamp_ns)) for run in runs)
    return np.arange(0, longest + FRAME_NS, FRAME_NS) / NS_PER_S


def opening_time(runs: Sequence[Run]) -> float:
    """Return the time [s] that the film shows first: of the closest approach to an obstacle.

    Without obstacles, of the largest distance from the coarse path. Both are moments at which the
    runs differ; at the start all cars are in one place.
    """
    moments = []
    for run in runs:
        nearest = np.fmin.reduce([np.full(len(run.series.t), np.inf), *run.series.v2o.values()])
        if not np.isfinite(nearest).any():
            nearest = -np.abs(run.series.contouring)
        k = int(np.nanargmin(nearest))
        moments.append((float(nearest[k]), float(run.series.t[k])))
    return min(moments)[1]


def car_frames(run: Run, t: np.ndarray) -> dict[str, Any]:
    """Return pose, speed and station of the car in each frame, its outline and circles [m].

    It stays where its run ends.
    """
    motion, series = run.drive.motion, run.series
    columns = {
        'x': motion.x,
        'y': motion.y,
        'yaw': np.unwrap(motion.yaw),
        'speed': series.speed,
        'station': series.station,
    }
    data = {name: np.interp(t, series.t, column) for name, column in columns.items()}
    facts = run.drive.facts
    body = {
        **facts.outline._asdict(),
        'circles': list(facts.circles),
        'radius': facts.vehicle_radius,
        'end': float(series.t[-1]),
    }
    return {**float32(t=t, **data), **body}


def plan_rows(run: Run, log: ControllerLog) -> dict[str, Any]:
    """Return the predicted horizon of each tick, a row per tick."""
    zero_ns = run.drive.motion.stamp_ns[0]
    length = max((len(plan.X) for plan in log.predictions), default=0)
    x, y = (
        np.array([_row(getattr(plan, axis), length) for plan in log.predictions])
        for axis in ('X', 'Y')
    )
    t = np.array([(plan.stamp_ns - zero_ns) / NS_PER_S for plan in log.predictions])
    return float32(t=t, x=x, y=y)


def candidate_rows(run: Run, log: ControllerLog) -> dict[str, Any]:
    """Return the plans that were compared and not chosen: a row per tick, gaps between them."""
    zero_ns, gap = run.drive.motion.stamp_ns[0], np.full((1, 2), np.nan)
    ticks = [
        np.concatenate([gap, *(part for c in lines if not c.is_chosen for part in (c.points, gap))])
        for lines in log.candidates
    ]
    length = max(map(len, ticks), default=0)
    padded = np.full((len(ticks), length, 2), np.nan)
    for row, points in zip(padded, ticks):
        row[: len(points)] = points
    t = (log.report_ns[: len(ticks)] - zero_ns) / NS_PER_S
    return float32(t=t, x=padded[..., 0], y=padded[..., 1])


def _row(values, length):
    padded = np.append(values, np.full(length - len(values), np.nan))
    return padded[::STAGE_EVERY]


def obstacle_frames(scene: Scene, start_ns: int, t: np.ndarray) -> dict[str, Any]:
    """Return the position of each obstacle in each frame, a row per frame."""
    stamp_ns = start_ns + np.round(t * NS_PER_S).astype(np.int64)
    positions = [obstacle_position(obstacle, scene, stamp_ns) for obstacle in scene.obstacles]
    x, y = (np.array([xy[axis] for xy in positions]).T for axis in (0, 1))
    return float32(t=t, x=x, y=y)


class TopView(NamedTuple):
    """The figure and the data of its animation, for the script of the page."""

    plot: figure
    obstacles: dict[str, Any]  # positions in each frame
    places: ColumnDataSource | None  # drawn positions
    runs: list[dict[str, Any]]  # of each: name and numbers of car and plans; what is drawn


def build_top_view(
    runs: Sequence[Run], logs: Mapping[str, ControllerLog], overlays: Sequence[Overlay] = ()
) -> TopView:
    """Return the road from above, with the scene of the first run.

    Everything that moves is drawn from sources that the page updates for every frame.
    """
    low, high = comparison_figures.road_limits(runs)
    road = float(np.clip(WIDTH * comparison_figures.road_aspect(runs), *HEIGHTS))
    height = road + FLAG_HEIGHT * min(len(runs), style.MANY)
    top = low[1] + (high[1] - low[1]) * height / road
    plot = new_figure(
        'film',
        'X [m]',
        'Y [m]',
        x_range=Range1d(low[0], high[0]),
        y_range=Range1d(low[1], top),
        height=round(height),
        tools='pan,wheel_zoom,reset,save',
        active_drag='pan',
    )
    scene, facts = runs[0].drive.scene, runs[0].drive.facts
    _draw_road(plot, scene, facts)
    t = frame_times(runs)
    still = obstacle_frames(scene, runs[0].drive.motion.stamp_ns[0], t)
    places = _draw_obstacles(plot, scene, facts, still)
    for run in runs:
        _trajectory(plot, run)
    for overlay in overlays:
        path = overlay.path()
        if path is not None:
            source = ColumnDataSource(float32(x=path[:, 0], y=path[:, 1]))
            tag_run(overlay, plot.line('x', 'y', source=source, **line_look(overlay)))
    moving = [
        {
            'name': run.name,
            'car': car_frames(run, t),
            'plan': plan_rows(run, logs[run.name]),
            'others': candidate_rows(run, logs[run.name]),
            **_moving(plot, run),
        }
        for run in runs
    ]
    return TopView(plot, still, places, moving)


def _draw_road(plot, scene, facts):
    road_area = np.concatenate([scene.left, scene.right[::-1]])
    plot.patch(*road_area.T, fill_color=style.QUIET, fill_alpha=0.08, line_color=None)
    keep_off = facts.vehicle_radius + facts.safe_edge
    for edge, inside in ((scene.left, -1.0), (scene.right, 1.0)):
        strip = np.concatenate([edge, geometry.offset_polyline(edge, inside * keep_off)[::-1]])
        plot.patch(*strip.T, fill_color=style.UNSAFE, fill_alpha=0.18, line_color=None)
        plot.line(*edge.T, line_color=style.EDGE, line_width=2)
    plot.line(*scene.reference.T, line_color=style.COARSE_PATH, line_width=6)


def _draw_obstacles(plot, scene, facts, still):
    """Ellipses, not circles: the road is drawn wider than it is long."""
    if not scene.obstacles:
        return None
    radius = np.array([obstacle.radius for obstacle in scene.obstacles])
    touch = radius + facts.vehicle_radius
    source = ColumnDataSource(
        {
            'x': still['x'][0],
            'y': still['y'][0],
            'id': [str(obstacle.id) for obstacle in scene.obstacles],
            'body': 2.0 * radius,
            'touch': 2.0 * touch,
            'unsafe': 2.0 * (touch + facts.safe_obstacle),
        }
    )
    looks = (('unsafe', style.UNSAFE, 0.22), ('touch', style.COLLISION, 0.16))
    for reach, colour, alpha in looks:
        area = {'fill_color': colour, 'fill_alpha': alpha, 'line_color': colour}
        plot.ellipse('x', 'y', reach, reach, source=source, **area)
    body = plot.ellipse('x', 'y', 'body', 'body', source=source, color=style.EDGE)
    tips = [('obstacle', '@id'), ('X', '@x{0.00} m'), ('Y', '@y{0.00} m')]
    plot.add_tools(HoverTool(renderers=[body], tooltips=tips))
    return source


def _trajectory(plot, run):
    motion = run.drive.motion
    chosen = np.union1d(decimate(motion.y, BINS), decimate(motion.x, BINS))
    columns = {'x': motion.x, 'y': motion.y, 'time': run.series.t, 'speed': run.series.speed}
    source = ColumnDataSource(float32(**{name: c[chosen] for name, c in columns.items()}))
    line = tag_run(run, plot.line('x', 'y', source=source, **line_look(run)))
    line.glyph.line_alpha = 0.6
    tips = [('run', run.name), ('time', '@time{0.00} s'), ('speed', '@speed{0.0} m/s')]
    plot.add_tools(HoverTool(renderers=[line], tooltips=tips))


def _moving(plot, run):
    horizon, body, candidates, pole = (ColumnDataSource({'x': [], 'y': []}) for _ in range(4))
    circles = ColumnDataSource({'x': [], 'y': [], 'width': []})
    flag = ColumnDataSource({'x': [], 'y': [], 'text': []})
    ink = {'line_color': run.colour}
    filled = {'fill_color': run.colour, 'fill_alpha': 0.12}
    look = line_look(run)
    thin = {'line_alpha': 0.5, **ink}
    text = {'text_color': run.colour, 'text_font_size': '13px', 'text_font_style': 'bold'}
    for drawn in (
        plot.line('x', 'y', source=candidates, line_alpha=0.35, line_width=1.5, **ink),
        plot.line('x', 'y', source=horizon, line_alpha=0.6, **ink),
        plot.scatter('x', 'y', source=horizon, size=4, line_color=None, fill_color=run.colour),
        plot.patch('x', 'y', source=body, **filled, **look),
        plot.ellipse('x', 'y', 'width', 'width', source=circles, fill_color=None, **thin),
        plot.line('x', 'y', source=pole, **thin),
        plot.text(
            'x', 'y', 'text', source=flag, text_align='center', text_baseline='middle', **text
        ),
    ):
        tag_run(run, drawn)
    sources = {'horizon': horizon, 'body': body, 'circles': circles, 'candidates': candidates}
    return {**sources, 'pole': pole, 'flag': flag}
