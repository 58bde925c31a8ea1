"""The road from above as a Bokeh figure that the page turns into a film."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool, Range1d
from bokeh.plotting import figure

from bags.pictures import palette, road
from bags.pictures.panels import Run
from bags.report import film, plots, thin
from bags.report.account import Account
from bags.verdict import geometry

HEIGHTS = (240, 620)  # CSS pixels
WIDTH = 1100  # CSS pixels, of the page on a desktop


class View(NamedTuple):
    """The figure and what sets it in motion, all of it for the script of the page."""

    plot: figure
    obstacles: dict[str, Any]  # where each is in each frame
    places: ColumnDataSource | None  # where each is drawn
    runs: list[dict[str, Any]]  # of each: name, car, plan; sources drawn: body, circles, horizon


def build(runs: Sequence[Run], accounts: Mapping[str, Account]) -> View:
    """Return the road from above, with the scene of the first run.

    What moves is drawn from sources that the page fills anew for every frame.
    """
    low, high = road.view(runs)
    height = float(np.clip(WIDTH * road.shape(runs), *HEIGHTS))
    plot = figure(
        name='film',
        x_range=Range1d(low[0], high[0]),
        y_range=Range1d(low[1], high[1]),
        x_axis_label='X [m]',
        y_axis_label='Y [m]',
        height=round(height),
        sizing_mode='stretch_width',
        tools='pan,wheel_zoom,reset,save',
        active_drag='pan',
        active_scroll=None,
        output_backend='canvas',
    )
    plots.dress(plot)
    scene, facts = runs[0].drive.scene, runs[0].drive.facts
    _road(plot, scene, facts)
    t = film.times(runs)
    still = film.obstacles(scene, runs[0].drive.motion.stamp_ns[0], t)
    places = _obstacles(plot, scene, facts, still)
    for run in runs:
        _trajectory(plot, run)
    moving = [
        {
            'name': run.name,
            'car': film.car(run, t),
            'plan': film.plan(run, accounts[run.name]),
            **_moving(plot, run),
        }
        for run in runs
    ]
    return View(plot, still, places, moving)


def _road(plot, scene, facts):
    road_area = np.concatenate([scene.left, scene.right[::-1]])
    plot.patch(*road_area.T, fill_color=palette.QUIET, fill_alpha=0.08, line_color=None)
    keep_off = facts.vehicle_radius + facts.safe_edge
    for edge, inside in ((scene.left, -1.0), (scene.right, 1.0)):
        strip = np.concatenate([edge, geometry.beside(edge, inside * keep_off)[::-1]])
        plot.patch(*strip.T, fill_color=palette.UNSAFE, fill_alpha=0.18, line_color=None)
        plot.line(*edge.T, line_color=palette.EDGE, line_width=2)
    plot.line(*scene.reference.T, line_color=palette.REFERENCE, line_dash='dashed')


def _obstacles(plot, scene, facts, still):
    """Ellipses, not circles: the road is drawn wider than it is long."""
    if not scene.obstacles:
        return None
    radius = np.array([one.radius for one in scene.obstacles])
    touch = radius + facts.vehicle_radius
    source = ColumnDataSource(
        {
            'x': still['x'][0],
            'y': still['y'][0],
            'id': [str(one.id) for one in scene.obstacles],
            'body': 2.0 * radius,
            'touch': 2.0 * touch,
            'unsafe': 2.0 * (touch + facts.safe_obstacle),
        }
    )
    looks = (('unsafe', palette.UNSAFE, 0.22), ('touch', palette.COLLISION, 0.16))
    for reach, colour, alpha in looks:
        area = {'fill_color': colour, 'fill_alpha': alpha, 'line_color': colour}
        plot.ellipse('x', 'y', reach, reach, source=source, **area)
    body = plot.ellipse('x', 'y', 'body', 'body', source=source, color=palette.EDGE)
    tips = [('obstacle', '@id'), ('X', '@x{0.00} m'), ('Y', '@y{0.00} m')]
    plot.add_tools(HoverTool(renderers=[body], tooltips=tips))
    return source


def _trajectory(plot, run):
    motion = run.drive.motion
    chosen = np.union1d(thin.keep(motion.y, plots.BINS), thin.keep(motion.x, plots.BINS))
    source = ColumnDataSource(
        {
            'x': motion.x[chosen].astype(np.float32),
            'y': motion.y[chosen].astype(np.float32),
            'time': run.series.t[chosen].astype(np.float32),
            'speed': run.series.speed[chosen].astype(np.float32),
        }
    )
    line = plots.of_run(run, plot.line('x', 'y', source=source, **plots.look(run)))
    line.glyph.line_alpha = 0.6
    tips = [('run', run.name), ('time', '@time{0.00} s'), ('speed', '@speed{0.0} m/s')]
    plot.add_tools(HoverTool(renderers=[line], tooltips=tips))


def _moving(plot, run):
    horizon, body = (ColumnDataSource({'x': [], 'y': []}) for _ in range(2))
    circles = ColumnDataSource({'x': [], 'y': [], 'width': []})
    ink = {'line_color': run.colour}
    filled = {**ink, 'fill_color': run.colour, 'fill_alpha': 0.45}
    hollow = {**ink, 'fill_color': None, 'line_dash': 'dotted'}
    for drawn in (
        plot.line('x', 'y', source=horizon, **ink),
        plot.scatter('x', 'y', source=horizon, size=4, **filled),
        plot.patch('x', 'y', source=body, **filled),
        plot.ellipse('x', 'y', 'width', 'width', source=circles, **hollow),
    ):
        plots.of_run(run, drawn)
    return {'horizon': horizon, 'body': body, 'circles': circles}
