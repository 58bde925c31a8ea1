"""The panels of report.html as Bokeh figures: linked axes, hover, a cursor that follows the film.

Signals of 1 kHz are decimated so that every extreme stays visible.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from bokeh.models import (
    BoxAnnotation,
    ColumnDataSource,
    GlyphRenderer,
    HoverTool,
    Range1d,
    Span,
)
from bokeh.plotting import figure

from bags.evaluation.drive import Facts
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.figures import style
from bags.figures.overlay import STATION, TIME, Overlay
from bags.figures.panels import FAR_M, LEAST_SPANS, SIGNALS, axis_limits, friction_circle

BINS = 600  # a panel is at most about that many pixels wide
HEIGHT = 260  # CSS pixels
SQUARE = 330
FLOOR_M = -100.0  # deeper than circles overlap
NS = 1e-9
CURVE = 'curve'  # tag of the lines that the page switches between time and station
CURSOR = 'cursor'


def decimate(values: np.ndarray, bins: int) -> np.ndarray:
    """Return the indices (k,) of the samples of `values` (n,) to draw, ascending.

    The samples are split into `bins` stretches of nearly equal length, and of each the smallest
    and the largest are kept: so every extreme is drawn, and the line covers the same band as the
    line through all samples. The first and the last sample are kept, too, and one not-a-number
    of a stretch that has any, so that gaps stay gaps. At most 3 bins + 2 indices remain.
    """
    n = len(values)
    if n <= 3 * bins + 2:
        return np.arange(n)
    bounds = np.linspace(0, n, bins + 1).astype(int)
    lengths = np.diff(bounds)
    # a stretch is a row; the shorter ones repeat their last sample
    rows = bounds[:-1, None] + np.minimum(np.arange(lengths.max()), lengths[:, None] - 1)
    stretches = values[rows]
    missing = np.isnan(stretches)
    lowest = np.argmin(np.where(missing, np.inf, stretches), axis=1)
    highest = np.argmax(np.where(missing, -np.inf, stretches), axis=1)
    each = np.arange(bins)
    chosen = [rows[each, lowest], rows[each, highest], [0, n - 1]]
    gaps = missing.any(axis=1)
    chosen.append(rows[each[gaps], np.argmax(missing[gaps], axis=1)])
    return np.unique(np.concatenate(chosen))


Curve = tuple[np.ndarray, np.ndarray]  # stamps (n,) [ns] and values (n,)


class Panel(NamedTuple):
    """One pair of axes against time or station."""

    name: str  # also the id of its element on the page
    title: str
    axis: str  # label of the vertical axis, with its unit
    # None: the signal of this name in SIGNALS
    line: Callable[[EvaluatedDrive], Curve | None] | None = None
    # the safety distance of a run; None where that has no meaning
    unsafe: Callable[[Facts], float] | None = None
    least_top: float = 0.0  # of an axis that begins at 0


def _v2o(run):
    """Return the distance to the nearest obstacle: more lines would not be readable."""
    if not run.series.v2o:
        return None
    nearest = np.fmin.reduce(list(run.series.v2o.values()))
    return run.stamp_ns, np.where(nearest < FAR_M, nearest, np.nan)


def _edge(side):
    def line(run):
        return run.stamp_ns, run.series.v2e[side]

    title = f'Distance to the {side} edge'
    return Panel(f'v2e_{side}', title, 'D_V2E [m]', line, lambda facts: facts.safe_edge)


def _reported(name):
    return lambda run: (run.log.report_ns, run.log.numbers[name]) if run.log.numbers else None


def _friction(axle):
    """Return the panel of the share of the friction that the controller's model uses."""
    title, line = f'Friction use in the controller, {axle} axle', _reported(f'friction.{axle}')
    return Panel(f'friction_{axle}', title, 'F / µF_z', line, least_top=1.05)


PANELS = (
    Panel('v2o', 'Distance to the nearest obstacle', 'D_V2O [m]', _v2o, lambda r: r.safe_obstacle),
    *map(_edge, ('left', 'right')),
    Panel('contouring', 'Distance from the coarse path', 'left positive [m]'),
    Panel('velocity', 'Longitudinal velocity', 'v_x [m/s]'),
    Panel('sideslip', 'Sideslip angle', 'β [deg]'),
    Panel('lateral', 'Lateral acceleration', 'a_y [m/s²]'),
    Panel('steer', 'Road-wheel angle', 'δ [deg]'),
    Panel('force', 'Longitudinal force, braking negative', 'F_x [kN]'),
    *map(_friction, ('front', 'rear')),
    Panel('solve', 'Solve time per tick', '[ms]', _reported('time.solve_ms'), least_top=20.0),
)


def plot_panel(
    panel: Panel,
    runs: Sequence[EvaluatedDrive],
    time_axis: Range1d,
    overlays: Sequence[Overlay] = (),
) -> figure | None:
    """Return the figure of a panel over `time_axis` [s]; None when no run has anything to show."""
    line = panel.line or SIGNALS[panel.name]
    drawn = [(run, *curve) for run in runs if (curve := line(run))]
    drawn = [curve for curve in drawn if np.isfinite(curve[-1]).any()]
    if not drawn:
        return None
    plot = new_figure(panel.name, 'time [s]', panel.axis, title=panel.title, x_range=time_axis)
    laid = [o for o in overlays if np.isfinite(o.signals.get(panel.name, np.nan)).any()]
    values = [curve[-1] for curve in drawn] + [o.signals[panel.name] for o in laid]
    if panel.unsafe:
        # unsafe distances are shaded, red where circles overlap; the axis shows small ones
        safe = max(panel.unsafe(run.drive.facts) for run in runs)
        low = min([0.0, *(np.nanmin(column) for column in values)])
        plot.y_range = Range1d(float(low) - safe, FAR_M)
        look = {'fill_alpha': 0.2, 'line_color': None, 'level': 'underlay'}
        for bottom, top, colour in ((0.0, safe, style.UNSAFE), (FLOOR_M, 0.0, style.COLLISION)):
            plot.add_layout(BoxAnnotation(bottom=bottom, top=top, fill_color=colour, **look))
    elif panel.name in LEAST_SPANS:
        plot.y_range = Range1d(*axis_limits(panel.name, values))
    else:
        most = max(panel.least_top, *(1.05 * float(np.nanmax(column)) for column in values))
        plot.y_range = Range1d(0.0, most)
    lines = []
    for run, stamp_ns, column in drawn:
        chosen = decimate(column, BINS)
        at_ns = stamp_ns[chosen]
        line = _since(run, at_ns), run.station_at(at_ns), column[chosen]
        lines.append(_plot_curve(plot, run, *line))
    for overlay in laid:
        column = overlay.signals[panel.name]
        unknown = np.full(len(column), np.nan)
        places = (overlay.axes.get(axis) for axis in (TIME, STATION))
        places = (unknown if place is None else place for place in places)
        lines.append(_plot_curve(plot, overlay, *places, column))
    where = [('run', '$name'), (panel.axis, '@value{0.000}'), ('time', '@time{0.000} s')]
    where.append(('station', '@station{0.0} m'))
    plot.add_tools(HoverTool(renderers=lines, tooltips=where, mode='vline'))
    plot.add_layout(
        Span(dimension='height', location=0.0, line_color=style.QUIET, name=CURSOR, level='glyph')
    )
    return plot


def _plot_curve(plot, run, time, station, value):
    source = ColumnDataSource(float32(time=time, station=station, value=value))
    line = plot.line('time', 'value', source=source, name=run.name, **line_look(run))
    return tag_run(run, line, CURVE)


def plot_gg(runs: Sequence[EvaluatedDrive]) -> figure:
    """Return the accelerations at the centre of gravity within the friction circle."""
    circle, reach = friction_circle(runs)
    ranges = {'x_range': Range1d(-reach, reach), 'y_range': Range1d(-reach, reach)}
    labels = ('a_y [m/s²], left positive', 'a_x [m/s²]')
    plot = new_figure('gg', *labels, title='G-G diagram', **ranges)
    plot.sizing_mode, plot.width, plot.height = 'fixed', SQUARE, SQUARE
    plot.line(*circle, line_color=style.EDGE)
    for run in runs:
        acc = run.drive.accelerations
        chosen = np.union1d(decimate(acc.ax, BINS), decimate(acc.ay, BINS))
        time = _since(run, acc.stamp_ns[chosen])
        source = ColumnDataSource(float32(x=acc.ay[chosen], y=acc.ax[chosen], time=time))
        line = tag_run(run, plot.line('x', 'y', source=source, **line_look(run)))
        tips = [('run', run.name), ('a_y', '@x{0.00}'), ('a_x', '@y{0.00}')]
        tips.append(('time', '@time{0.00} s'))
        plot.add_tools(HoverTool(renderers=[line], tooltips=tips))
    return plot


def tag_run(run: EvaluatedDrive | Overlay, drawn: GlyphRenderer, *tags: str) -> GlyphRenderer:
    """Tag a glyph with its run, so that the page can hide it; return it."""
    drawn.tags = [f'run:{run.name}', *tags]
    return drawn


def line_look(run: EvaluatedDrive | Overlay) -> dict:
    """Return colour, width and dash of the lines of a run."""
    look = run.look
    dash = [max(1, round(part)) for part in look.dash]
    return {'line_color': look.colour, 'line_width': look.width, 'line_dash': dash}


def new_figure(name: str, x_label: str, y_label: str, **options: Any) -> figure:
    """Return a figure in the style of the page: transparent, few lines."""
    options = {'tools': 'pan,box_zoom,wheel_zoom,reset,save', 'active_drag': 'box_zoom'} | options
    plot = figure(
        name=name,
        x_axis_label=x_label,
        y_axis_label=y_label,
        sizing_mode='stretch_width',
        active_scroll=None,
        output_backend='canvas',
        **{'height': HEIGHT, **options},
    )
    plot.background_fill_color = plot.border_fill_color = None
    plot.outline_line_color = None
    plot.title.text_color = style.INK
    plot.title.text_font = plot.axis.axis_label_text_font = 'system-ui, sans-serif'
    plot.title.text_font_size = '15px'
    plot.axis.axis_label_text_font_style = 'normal'
    plot.axis.axis_label_text_color = plot.axis.major_label_text_color = style.INK
    plot.axis.axis_line_color = plot.axis.major_tick_line_color = style.QUIET
    plot.axis.minor_tick_line_color = None
    plot.grid.grid_line_color = style.RC['grid.color']
    plot.toolbar.logo = None
    plot.toolbar.autohide = True
    return plot


def _since(run, stamp_ns):
    return (stamp_ns - run.drive.motion.stamp_ns[0]) * NS


def float32(**columns: np.ndarray) -> dict[str, np.ndarray]:
    """Return columns as float32: more digits than visible, half the size."""
    return {name: np.asarray(column, dtype=np.float32) for name, column in columns.items()}
