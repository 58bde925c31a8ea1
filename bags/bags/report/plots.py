"""The panels as Bokeh figures: linked axes, hover, and a cursor that follows the film."""

from collections.abc import Mapping, Sequence

import numpy as np
from bokeh.models import (
    BoxAnnotation,
    ColumnDataSource,
    DataRange1d,
    GlyphRenderer,
    HoverTool,
    Range1d,
    Span,
)
from bokeh.plotting import figure

from bags.pictures import palette
from bags.pictures.panels import FAR_M, GRAVITY, Run
from bags.report import thin
from bags.report.account import Account
from bags.report.curves import Panel

BINS = 600  # a panel is at most about that many pixels wide
HEIGHT = 260  # CSS pixels
SQUARE = 330
FLOOR_M = -100.0  # deeper than circles overlap
NS = 1e-9
CURVE = 'curve'  # tag of what the page switches between time and station
CURSOR = 'cursor'


def panel(
    one: Panel, runs: Sequence[Run], accounts: Mapping[str, Account], time_axis: Range1d
) -> figure | None:
    """Return the figure of a panel over `time_axis` [s]; None when no run has anything to show."""
    drawn = [
        (run, curve)
        for run in runs
        for curve in one.curves(run, accounts[run.name])
        if np.isfinite(curve.values).any()
    ]
    if not drawn:
        return None
    plot = _figure(one.name, one.title, 'time [s]', one.axis, x_range=time_axis)
    if one.unsafe:
        _shade(plot, max(one.unsafe(run.drive.facts) for run in runs), drawn)
    lines = [_line(plot, run, curve) for run, curve in drawn]
    where = [('run', '$name'), (one.axis, '@value{0.000}'), ('time', '@time{0.000} s')]
    hover = HoverTool(
        renderers=lines, tooltips=[*where, ('station', '@station{0.0} m')], mode='vline'
    )
    plot.add_tools(hover)
    plot.add_layout(
        Span(dimension='height', location=0.0, line_color=palette.QUIET, name=CURSOR, level='glyph')
    )
    return plot


def gg(runs: Sequence[Run]) -> figure:
    """Return the accelerations at the centre of gravity within the friction circle."""
    radius = GRAVITY * max(run.drive.facts.friction for run in runs)
    measured = np.concatenate([(*run.drive.accelerations[1:],) for run in runs], axis=1)
    reach = 1.08 * max(radius, float(np.abs(measured).max(initial=0.0)))
    ranges = {'x_range': Range1d(-reach, reach), 'y_range': Range1d(-reach, reach)}
    plot = _figure('gg', 'G-G diagram', 'a_y [m/s²], left positive', 'a_x [m/s²]', **ranges)
    plot.sizing_mode, plot.width, plot.height = 'fixed', SQUARE, SQUARE
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = {'line_color': palette.EDGE, 'line_dash': 'dotted'}
    plot.line(radius * np.cos(angle), radius * np.sin(angle), **circle)
    for run in runs:
        acc = run.drive.accelerations
        chosen = np.union1d(thin.keep(acc.ax, BINS), thin.keep(acc.ay, BINS))
        source = ColumnDataSource(
            {
                'x': _short(acc.ay[chosen]),
                'y': _short(acc.ax[chosen]),
                'time': _short(_since(run, acc.stamp_ns[chosen])),
            }
        )
        line = of_run(run, plot.line('x', 'y', source=source, **look(run)))
        tips = [('run', run.name), ('a_y', '@x{0.00}'), ('a_x', '@y{0.00}')]
        tips.append(('time', '@time{0.00} s'))
        plot.add_tools(HoverTool(renderers=[line], tooltips=tips))
    return plot


def of_run(run: Run, drawn: GlyphRenderer, *tags: str) -> GlyphRenderer:
    """Tag what is drawn of a run, so that the page can hide it; return it."""
    drawn.tags = [f'run:{run.name}', *tags]
    return drawn


def look(run: Run) -> dict:
    """Return how the lines of a run look."""
    dash = 'dashed' if run.name in palette.KNOWN_DASHES else 'solid'
    return {'line_color': run.colour, 'line_width': 2, 'line_dash': dash}


def _figure(name, title, x_label, y_label, **ranges):
    plot = figure(
        name=name,
        title=title,
        x_axis_label=x_label,
        y_axis_label=y_label,
        height=HEIGHT,
        sizing_mode='stretch_width',
        tools='pan,box_zoom,wheel_zoom,reset,save',
        active_drag='box_zoom',
        active_scroll=None,
        output_backend='canvas',
        **ranges,
    )
    return dress(plot)


def dress(plot: figure) -> figure:
    """Let the page shine through a figure, and the data stand before everything else."""
    plot.background_fill_color = plot.border_fill_color = None
    plot.outline_line_color = None
    plot.title.text_color = palette.INK
    plot.title.text_font = plot.axis.axis_label_text_font = 'system-ui, sans-serif'
    plot.title.text_font_size = '15px'
    plot.axis.axis_label_text_font_style = 'normal'
    plot.axis.axis_label_text_color = plot.axis.major_label_text_color = palette.INK
    plot.axis.axis_line_color = plot.axis.major_tick_line_color = palette.QUIET
    plot.axis.minor_tick_line_color = None
    plot.grid.grid_line_color = palette.RC['grid.color']
    plot.toolbar.logo = None
    plot.toolbar.autohide = True
    return plot


def _line(plot, run, curve):
    chosen = thin.keep(curve.values, BINS)
    stamp_ns = curve.stamp_ns[chosen]
    station = np.interp(stamp_ns, run.drive.motion.stamp_ns, run.series.station)
    source = ColumnDataSource(
        {
            'time': _short(_since(run, stamp_ns)),
            'station': _short(station),
            'value': _short(curve.values[chosen]),
        }
    )
    label = f'{run.name}, {curve.label}' if curve.label else run.name
    drawn = {**look(run), 'line_dash': curve.dash} if curve.label else look(run)
    return of_run(run, plot.line('time', 'value', source=source, name=label, **drawn), CURVE)


def _shade(plot, safe, drawn):
    """Shade the unsafe distances, darker where the circles overlap; show what is near."""
    low = min([0.0, *(np.nanmin(curve.values) for _, curve in drawn)])
    plot.y_range = DataRange1d(start=float(low) - safe, end=FAR_M)
    areas = ((0.0, safe, palette.UNSAFE), (FLOOR_M, 0.0, palette.COLLISION))
    for bottom, top, colour in areas:
        shade = {'fill_color': colour, 'fill_alpha': 0.2, 'line_color': None, 'level': 'underlay'}
        plot.add_layout(BoxAnnotation(bottom=bottom, top=top, **shade))


def _since(run, stamp_ns):
    return (stamp_ns - run.drive.motion.stamp_ns[0]) * NS


def _short(values):
    """Seven digits are more than a reader sees, and half the size."""
    return np.asarray(values, dtype=np.float32)
