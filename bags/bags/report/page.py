"""Write report.html with Bokeh: figures, animation, metrics and provenance in one HTML file.

The panels have linked axes, hover and a cursor that follows the film; signals of 1 kHz are
decimated so that every extreme stays visible. The film shows cars, plans and obstacles in each
frame, drawn on the road: positions are in the frame map [m], angles in rad, times in s since the
first state of a run. The script of the page only looks up these numbers and rotates the outline.
"""

from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

import jinja2
import numpy as np
from bokeh.document import Document
from bokeh.embed import components
from bokeh.models import BoxAnnotation, ColumnDataSource, CustomJS, HoverTool, Range1d, Span
from bokeh.plotting import figure
from bokeh.resources import Resources

from bags import metrics_table
from bags.evaluation import metrics
from bags.evaluation.drive import PREDICTION, WHY, candidate_lines
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.figures import comparison_figures, scene, style
from bags.figures.overlay import STATION, TIME, Overlay
from bags.report.comparability import describe_runs, origin_rows, parameter_rows
from bags.storage.invalid_messages import KEY
from msgs_yaml.conversions import NS_PER_S

REPORT_FILE = 'report.html'
PAGE = files('bags.report') / 'page'
START = 'startReport(film, panels)'  # in report.js
GOOD = {True: 'good', False: 'bad', None: ''}
BINS = 600  # a panel is at most about that many pixels wide
HEIGHT = 260  # CSS pixels
SQUARE = 330
FLOOR_M = -100.0  # deeper than circles overlap
CURVE = 'curve'  # tag of the lines that the page switches between time and station
CURSOR = 'cursor'
PLAIN = str.maketrans('', '', '${}')  # of mathematics in a label
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


def report_html(
    values: Mapping[str, Any], runs: Sequence[EvaluatedDrive], overlays: Sequence[Overlay] = ()
) -> str:
    """Return the page with all styles, scripts and data inside: it loads nothing.

    `values` are those of comparison.json; the runs have names and looks.
    """
    infos = [run.run_info for run in runs]
    with_paper = values.get(metrics_table.OF_PAPER, False)
    view = build_top_view(runs, overlays)
    duration = float(view['obstacles']['t'][-1])
    time_axis = Range1d(0.0, duration)
    drawn = (plot_panel(panel, runs, time_axis, overlays) for panel in comparison_figures.PANELS)
    plots = [*filter(None, drawn), plot_gg(runs)]
    shaded = {panel.name for panel in comparison_figures.PANELS if panel.safe}
    document = Document()
    # one pass over all models instead of one per figure
    with document.models.freeze():
        for plot in (view['plot'], *plots):
            document.add_root(plot)
    arguments = {'film': view, 'panels': plots}
    document.js_on_event('document_ready', CustomJS(args=arguments, code=START))
    # the script with all figures, and the HTML element of each by name
    figures = {plot.name: plot for plot in (view['plot'], *plots)}
    script, divs = components(figures, wrap_script=False)
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    environment.trim_blocks = environment.lstrip_blocks = True
    template = environment.from_string((PAGE / 'report.html').read_text())
    return template.render(
        scenario=values['scenario'],
        runs=[(run.name, run.look) for run in runs],
        has_many=len(runs) > style.MANY,
        legend=style.legend_looks(runs),
        most_flags=style.MANY,
        about=describe_runs([run.name for run in runs], infos),
        overlays=[(laid.name, laid.look, sorted(laid.signals)) for laid in overlays],
        areas=style.AREAS,
        shaded=shaded,
        coarse_path=style.COARSE_PATH,
        glossary=metrics.METRICS.values(),
        damage=values.get('damage', {}),
        invalid=values.get(KEY, {}),
        verdicts={name: run['verdict'] for name, run in values['runs'].items()},
        duration=duration,
        opening=opening_time(runs),
        film=divs.pop('film'),
        gg=divs.pop('gg'),
        panels=divs,
        lines=metrics_table.table_lines(values['runs']),
        paper_note=metrics_table.PAPER_NOTE if with_paper else '',
        colour_note=metrics_table.COLOUR_NOTE,
        good=GOOD,
        origin=origin_rows(infos),
        parameters=parameter_rows(infos),
        bokeh_js='\n'.join(Resources(mode='inline', components=['bokeh']).js_raw),
        bokeh_script=script,
        style=(PAGE / 'report.css').read_text(),
        script=(PAGE / 'report.js').read_text(),
    )


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


def _curve(panel, run):
    """Return the curve of a panel, None without any; of several obstacles that to the nearest."""
    curves = comparison_figures.CURVES[panel.name](run)
    if panel.name != 'v2o' or not curves:
        return curves[0] if curves else None
    # more lines would not be readable
    nearest = np.fmin.reduce([gap for _, gap in curves])
    return run.stamp_ns, np.where(nearest < comparison_figures.FAR_M, nearest, np.nan)


def plot_panel(
    panel: comparison_figures.Panel,
    runs: Sequence[EvaluatedDrive],
    time_axis: Range1d,
    overlays: Sequence[Overlay] = (),
) -> figure | None:
    """Return the figure of a panel over `time_axis` [s]; None when no run has anything to show."""
    drawn = [(run, *curve) for run in runs if (curve := _curve(panel, run))]
    drawn = [curve for curve in drawn if np.isfinite(curve[-1]).any()]
    if not drawn:
        return None
    axis = panel.axis.translate(PLAIN)
    title = f'{panel.title}, the nearest' if panel.name == 'v2o' else panel.title
    plot = _new_figure(panel.name, 'time [s]', axis, title=title, x_range=time_axis)
    laid = [o for o in overlays if np.isfinite(o.signals.get(panel.name, np.nan)).any()]
    values = [curve[-1] for curve in drawn] + [o.signals[panel.name] for o in laid]
    if panel.safe:
        # unsafe distances are shaded, red where circles overlap; the axis shows small ones
        safe = comparison_figures.safe_distance(runs, panel)
        low = min([0.0, *(np.nanmin(column) for column in values)])
        plot.y_range = Range1d(float(low) - safe, comparison_figures.FAR_M)
        look = {'fill_alpha': 0.2, 'line_color': None, 'level': 'underlay'}
        for bottom, top, colour in ((0.0, safe, style.UNSAFE), (FLOOR_M, 0.0, style.COLLISION)):
            plot.add_layout(BoxAnnotation(bottom=bottom, top=top, fill_color=colour, **look))
    elif panel.least_span:
        plot.y_range = Range1d(*comparison_figures.axis_limits(panel.least_span, values))
    else:
        most = max(panel.least_top, *(1.05 * float(np.nanmax(column)) for column in values))
        plot.y_range = Range1d(0.0, most)
    lines = []
    for run, stamp_ns, column in drawn:
        chosen = decimate(column, BINS)
        at_ns = stamp_ns[chosen]
        columns = {'time': _since(run, at_ns), 'station': run.station_at(at_ns)}
        columns['value'] = column[chosen]
        lines.append(_line(plot, run, ('time', 'value'), columns, CURVE))
    for overlay in laid:
        column = overlay.signals[panel.name]
        unknown = np.full(len(column), np.nan)
        axes = (('time', TIME), ('station', STATION))
        columns = {name: overlay.axes.get(axis, unknown) for name, axis in axes}
        columns['value'] = column
        lines.append(_line(plot, overlay, ('time', 'value'), columns, CURVE))
    where = [('run', '$name'), (axis, '@value{0.000}'), ('time', '@time{0.000} s')]
    where.append(('station', '@station{0.0} m'))
    plot.add_tools(HoverTool(renderers=lines, tooltips=where, mode='vline'))
    plot.add_layout(
        Span(dimension='height', location=0.0, line_color=style.QUIET, name=CURSOR, level='glyph')
    )
    return plot


def _line(plot, run, axes, columns, *tags):
    """Draw two of the columns of a run, or of an overlay; return the line."""
    source = ColumnDataSource(_float32(**columns))
    line = plot.line(*axes, source=source, name=run.name, **_line_look(run))
    return _tag_run(run, line, *tags)


def plot_gg(runs: Sequence[EvaluatedDrive]) -> figure:
    """Return the accelerations at the centre of gravity within the friction circle."""
    circle, reach = comparison_figures.friction_circle(runs)
    ranges = {'x_range': Range1d(-reach, reach), 'y_range': Range1d(-reach, reach)}
    labels = ('a_y [m/s²], left positive', 'a_x [m/s²]')
    plot = _new_figure('gg', *labels, title='G-G diagram', **ranges)
    plot.sizing_mode, plot.width, plot.height = 'fixed', SQUARE, SQUARE
    plot.line(*circle, line_color=style.EDGE)
    for run in runs:
        acc = run.drive.accelerations
        chosen = np.union1d(decimate(acc.ax, BINS), decimate(acc.ay, BINS))
        columns = {'x': acc.ay, 'y': acc.ax, 'time': _since(run, acc.stamp_ns)}
        line = _line(plot, run, ('x', 'y'), {name: c[chosen] for name, c in columns.items()})
        tips = [('run', run.name), ('a_y', '@x{0.00}'), ('a_x', '@y{0.00}')]
        tips.append(('time', '@time{0.00} s'))
        plot.add_tools(HoverTool(renderers=[line], tooltips=tips))
    return plot


def _tag_run(run, drawn, *tags):
    """Tag a glyph with its run, so that the page can hide it; return it."""
    drawn.tags = [f'run:{run.name}', *tags]
    return drawn


def _line_look(run):
    dash = [max(1, round(part)) for part in run.look.dash]
    return {'line_color': run.look.colour, 'line_width': run.look.width, 'line_dash': dash}


def _new_figure(name, x_label, y_label, **options):
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
    return (stamp_ns - run.stamp_ns[0]) / NS_PER_S


def _float32(**columns):
    """Return columns as float32: more digits than visible, half the size."""
    return {name: np.asarray(column, dtype=np.float32) for name, column in columns.items()}


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
    return {**_float32(t=t, **shown), **facts.outline._asdict(), **body, **end}


def _rows(run, sent, lines, every=1):
    """Return a line of points per message as rows of equal length, with not-a-number behind."""
    padded = np.full((len(lines), max(map(len, lines), default=0), 2), np.nan)
    for row, points in zip(padded, lines):
        row[: len(points)] = points
    t = _since(run, np.array([message.stamp_ns for message in sent]))
    return _float32(t=t, x=padded[:, ::every, 0], y=padded[:, ::every, 1])


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
    plot = _new_figure(
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
    still = _float32(t=t, x=x.T, y=y.T)
    places = _draw_obstacles(plot, seen, facts, still)
    for run in runs:
        motion = run.drive.motion
        chosen = np.union1d(decimate(motion.y, BINS), decimate(motion.x, BINS))
        columns = {'x': motion.x, 'y': motion.y, 'time': run.series.t, 'speed': run.series.speed}
        line = _line(plot, run, ('x', 'y'), {name: c[chosen] for name, c in columns.items()})
        line.glyph.line_alpha = 0.6
        tips = [('run', run.name), ('time', '@time{0.00} s'), ('speed', '@speed{0.0} m/s')]
        plot.add_tools(HoverTool(renderers=[line], tooltips=tips))
    for overlay in overlays:
        path = overlay.path()
        if path is not None:
            _line(plot, overlay, ('x', 'y'), {'x': path[:, 0], 'y': path[:, 1]})
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
    plans, reports, gap = run.sent(PREDICTION), run.sent(WHY), np.full((1, 2), np.nan)
    others = []
    for why in reports:
        lines = [line.points for line in candidate_lines(why.values) if not line.is_chosen]
        others.append(np.concatenate([gap, *(part for line in lines for part in (line, gap))]))
    points = [np.column_stack([plan.X, plan.Y]) for plan in plans]
    data = {
        'name': run.name,
        'car': car_frames(run, t),
        'plan': _rows(run, plans, points, scene.STAGE_EVERY),
        'others': _rows(run, reports, others),
    }
    names = ('horizon', 'body', 'candidates', 'pole', 'circles', 'flag')
    more = {'circles': {'width': []}, 'flag': {'text': []}}
    sources = {n: ColumnDataSource({'x': [], 'y': [], **more.get(n, {})}) for n in names}
    horizon, body, candidates, pole, circles, flag = sources.values()
    colour = run.look.colour
    ink, filled = {'line_color': colour}, {'fill_color': colour, 'fill_alpha': 0.12}
    look, thin = _line_look(run), {'line_alpha': 0.5, 'line_color': colour}
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
        _tag_run(run, drawn)
    return {**data, **sources}
