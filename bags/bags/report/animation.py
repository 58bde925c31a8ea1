"""The animation of the manoeuvre: cars, plans and obstacles in each frame, drawn on the road.

Positions are in the frame map [m], angles in rad, times in seconds since the first state of a run.
The script of the page only looks up these numbers and rotates the outline.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool, Range1d

from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.figures import comparison_figures, scene, style
from bags.figures.overlay import Overlay
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
HEIGHTS = (240, 620)  # CSS pixels
FLAG_HEIGHT = 18  # CSS pixels of a row above the road for the name of a car, at most MANY
WIDTH = 1100  # CSS pixels, of the page on a desktop
# by kind of a shape
AREAS = {
    'road': {'fill_color': style.QUIET, 'fill_alpha': 0.08},
    'strip': {'fill_color': style.UNSAFE, 'fill_alpha': 0.18},
}
LINES = {
    'edge': {'line_color': style.EDGE, 'line_width': 2},
    'path': {'line_color': style.COARSE_PATH, 'line_width': 6},
}
DISCS = {
    'unsafe': (style.UNSAFE, 0.22),
    'touch': (style.COLLISION, 0.16),
    'obstacle': (style.EDGE, 1.0),
}


def frame_times(runs: Sequence[EvaluatedDrive]) -> np.ndarray:
    """Return the times of the frames [s], from 0 to the end of the longest run."""
    longest = max(int(np.ptp(run.drive.motion.stamp_ns)) for run in runs)
    return np.arange(0, longest + FRAME_NS, FRAME_NS) / NS_PER_S


def opening_time(runs: Sequence[EvaluatedDrive]) -> float:
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


def car_frames(run: EvaluatedDrive, t: np.ndarray) -> dict[str, Any]:
    """Return pose, speed and station of the car in each frame, its outline and circles [m].

    It stays where its run ends.
    """
    states, facts = scene.states_at(run, t), run.drive.facts
    shown = {name: states[name] for name in ('x', 'y', 'yaw', 'speed', 'station')}
    body = {'circles': list(facts.circles), 'radius': facts.vehicle_radius}
    end = {'end': float(run.series.t[-1])}
    return {**float32(t=t, **shown), **facts.outline._asdict(), **body, **end}


def _rows(run, stamp_ns, lines, every=1):
    """Return lines of points as rows of equal length, with not-a-number behind each."""
    padded = np.full((len(lines), max(map(len, lines), default=0), 2), np.nan)
    for row, points in zip(padded, lines):
        row[: len(points)] = points
    t = (stamp_ns - run.stamp_ns[0]) / NS_PER_S
    return float32(t=t, x=padded[:, ::every, 0], y=padded[:, ::every, 1])


def build_top_view(
    runs: Sequence[EvaluatedDrive], overlays: Sequence[Overlay] = ()
) -> dict[str, Any]:
    """Return the road from above, with the scene of the first run, for the script of the page.

    Everything that moves is drawn from sources that the page updates for every frame: `plot` is the
    figure, `obstacles` their positions in each frame, `places` the drawn ones (None without any),
    `runs` of each its name, the numbers of car and plans, and what is drawn.
    """
    low, high = comparison_figures.road_limits(runs)
    road = float(np.clip(WIDTH * comparison_figures.road_aspect(runs), *HEIGHTS))
    height = road + FLAG_HEIGHT * min(len(runs), style.MANY)
    plot = new_figure(
        'film',
        'X [m]',
        'Y [m]',
        x_range=Range1d(low[0], high[0]),
        y_range=Range1d(low[1], low[1] + (high[1] - low[1]) * height / road),
        height=round(height),
        tools='pan,wheel_zoom,reset,save',
        active_drag='pan',
    )
    seen, facts = runs[0].drive.scene, runs[0].drive.facts
    keep_off = facts.vehicle_radius + facts.safe_edge
    for shape in scene.road_shapes(seen.left, seen.right, keep_off, seen.reference):
        if shape.kind in AREAS:
            plot.patch(*shape.points.T, line_color=None, **AREAS[shape.kind])
        elif shape.kind in LINES:
            plot.line(*shape.points.T, **LINES[shape.kind])
    t = frame_times(runs)
    x, y = np.moveaxis(scene.positions_at(runs[0], t), 1, 0)
    still = float32(t=t, x=x.T, y=y.T)
    places = _draw_obstacles(plot, seen, facts, still)
    for run in runs:
        motion = run.drive.motion
        chosen = np.union1d(decimate(motion.y, BINS), decimate(motion.x, BINS))
        columns = {'x': motion.x, 'y': motion.y, 'time': run.series.t, 'speed': run.series.speed}
        source = ColumnDataSource(float32(**{name: c[chosen] for name, c in columns.items()}))
        line = tag_run(run, plot.line('x', 'y', source=source, **line_look(run)))
        line.glyph.line_alpha = 0.6
        tips = [('run', run.name), ('time', '@time{0.00} s'), ('speed', '@speed{0.0} m/s')]
        plot.add_tools(HoverTool(renderers=[line], tooltips=tips))
    for overlay in overlays:
        path = overlay.path()
        if path is not None:
            source = ColumnDataSource(float32(x=path[:, 0], y=path[:, 1]))
            tag_run(overlay, plot.line('x', 'y', source=source, **line_look(overlay)))
    moving = [_moving(plot, run, t) for run in runs]
    return {'plot': plot, 'obstacles': still, 'places': places, 'runs': moving}


def _draw_obstacles(plot, seen, facts, still):
    """Ellipses, not circles: the road is drawn wider than it is long."""
    if not seen.obstacles:
        return None
    columns = {'x': still['x'][0], 'y': still['y'][0], 'id': [str(o.id) for o in seen.obstacles]}
    for o in seen.obstacles:
        discs = scene.obstacle_shapes(
            o.id, (0.0, 0.0), o.radius, facts.vehicle_radius, facts.safe_obstacle
        )
        for disc in discs:
            columns.setdefault(disc.kind, []).append(2.0 * disc.radius)
    source = ColumnDataSource(columns)
    for reach, (colour, alpha) in DISCS.items():
        area = {'fill_color': colour, 'fill_alpha': alpha, 'line_color': colour}
        drawn = plot.ellipse('x', 'y', reach, reach, source=source, **area)
    tips = [('obstacle', '@id'), ('X', '@x{0.00} m'), ('Y', '@y{0.00} m')]
    plot.add_tools(HoverTool(renderers=[drawn], tooltips=tips))
    return source


def _moving(plot, run, t):
    """Return name, car, plans and sources of a run: a row of points per plan.

    Of the plans that were compared those that were not chosen, with gaps between them.
    """
    plans = [np.column_stack([plan.X, plan.Y]) for plan in run.log.predictions]
    plan_ns = np.array([plan.stamp_ns for plan in run.log.predictions])
    gap = np.full((1, 2), np.nan)
    others = [
        np.concatenate([gap, *(part for c in lines if not c.is_chosen for part in (c.points, gap))])
        for lines in run.log.candidates
    ]
    data = {
        'name': run.name,
        'car': car_frames(run, t),
        'plan': _rows(run, plan_ns, plans, scene.STAGE_EVERY),
        'others': _rows(run, run.log.report_ns[: len(others)], others),
    }
    names = ('horizon', 'body', 'candidates', 'pole', 'circles', 'flag')
    more = {'circles': {'width': []}, 'flag': {'text': []}}
    sources = {n: ColumnDataSource({'x': [], 'y': [], **more.get(n, {})}) for n in names}
    horizon, body, candidates, pole, circles, flag = sources.values()
    colour = run.look.colour
    ink, filled = {'line_color': colour}, {'fill_color': colour, 'fill_alpha': 0.12}
    look, thin = line_look(run), {'line_alpha': 0.5, 'line_color': colour}
    text = {'text_color': colour, 'text_font_size': '13px', 'text_font_style': 'bold'}
    text |= {'text_align': 'center', 'text_baseline': 'middle'}
    for drawn in (
        plot.line('x', 'y', source=candidates, line_alpha=0.35, line_width=1.5, **ink),
        plot.line('x', 'y', source=horizon, line_alpha=0.6, **ink),
        plot.scatter('x', 'y', source=horizon, size=4, line_color=None, fill_color=colour),
        plot.patch('x', 'y', source=body, **filled, **look),
        plot.ellipse('x', 'y', 'width', 'width', source=circles, fill_color=None, **thin),
        plot.line('x', 'y', source=pole, **thin),
        plot.text('x', 'y', 'text', source=flag, **text),
    ):
        tag_run(run, drawn)
    return {**data, **sources}
