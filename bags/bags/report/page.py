"""Write report.html: figures, animation, metrics and provenance in one HTML file."""

from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

import jinja2
from bokeh.document import Document
from bokeh.embed import components
from bokeh.models import CustomJS, Range1d
from bokeh.resources import Resources

from bags import metrics_table
from bags.evaluation import metrics
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.figures import style
from bags.figures.overlay import Overlay
from bags.figures.panels import PANELS, legend_looks
from bags.report import page_figures
from bags.report.comparability import describe_runs, origin_rows, parameter_rows
from bags.storage.invalid_messages import KEY

REPORT_FILE = 'report.html'
PAGE = files('bags.report') / 'page'
START = 'startReport(film, panels)'  # in report.js
GOOD = {True: 'good', False: 'bad', None: ''}


def report_html(
    values: Mapping[str, Any], runs: Sequence[EvaluatedDrive], overlays: Sequence[Overlay] = ()
) -> str:
    """Return the page with all styles, scripts and data inside: it loads nothing.

    `values` are those of comparison.json; the runs have names and looks.
    """
    infos = [run.run_info for run in runs]
    with_paper = values.get(metrics_table.OF_PAPER, False)
    view = page_figures.build_top_view(runs, overlays)
    duration = float(view['obstacles']['t'][-1])
    time_axis = Range1d(0.0, duration)
    drawn = (page_figures.plot_panel(panel, runs, time_axis, overlays) for panel in PANELS)
    panels = [*filter(None, drawn), page_figures.plot_gg(runs)]
    shaded = {panel.name for panel in PANELS if panel.safe}
    document = Document()
    # one pass over all models instead of one per figure
    with document.models.freeze():
        for plot in (view['plot'], *panels):
            document.add_root(plot)
    arguments = {'film': view, 'panels': panels}
    document.js_on_event('document_ready', CustomJS(args=arguments, code=START))
    # the script with all figures, and the HTML element of each by name
    figures = {plot.name: plot for plot in (view['plot'], *panels)}
    script, divs = components(figures, wrap_script=False)
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    environment.trim_blocks = environment.lstrip_blocks = True
    template = environment.from_string((PAGE / 'report.html').read_text())
    return template.render(
        scenario=values['scenario'],
        runs=[(run.name, run.look) for run in runs],
        has_many=len(runs) > style.MANY,
        legend=legend_looks(runs),
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
        opening=page_figures.opening_time(runs),
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
