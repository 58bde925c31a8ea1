"""Put figures, film, numbers and provenance into one HTML file that needs nothing else."""

from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
from bokeh.document import Document
from bokeh.embed import components
from bokeh.models import CustomJS, Range1d
from bokeh.resources import Resources

from bags.pictures import palette, table
from bags.pictures.panels import Run
from bags.report import plots, provenance, top_view
from bags.report.account import NOTHING, Account
from bags.report.claims import Claim
from bags.report.curves import PANELS
from bags.storage import sift

FILE = 'report.html'
PAGE = files('bags.report') / 'page'
START = 'startReport(film, panels)'  # in report.js
GOOD = {True: 'good', False: 'bad', None: ''}


class Material(NamedTuple):
    """What the report is made of."""

    values: Mapping[str, Any]  # comparison.json
    runs: Sequence[Run]
    accounts: Mapping[str, Account]  # by run; a run may lack one
    claims: Sequence[Claim] = ()


def write(material: Material, file: Path) -> Path:
    """Write the report of a comparison; return `file`."""
    file.write_text(html(material), encoding='utf-8')
    return file


def html(material: Material) -> str:
    """Return the page: styles, scripts and data are inside, and nothing is fetched."""
    runs = material.runs
    accounts = {run.name: material.accounts.get(run.name, NOTHING) for run in runs}
    infos = [accounts[run.name].info for run in runs]
    view = top_view.build(runs, accounts)
    duration = float(view.obstacles['t'][-1])
    time_axis = Range1d(0.0, duration)
    panels = [plots.panel(one, runs, accounts, time_axis) for one in PANELS]
    panels = [plot for plot in panels if plot] + [plots.gg(runs)]
    script, divs = _embedded(view, panels)
    return _template().render(
        scenario=material.values['scenario'],
        runs=[(run.name, run.colour, run.name in palette.KNOWN_DASHES) for run in runs],
        damage=material.values.get('damage', {}),
        invalid=material.values.get(sift.KEY, {}),
        verdicts={name: found['verdict'] for name, found in material.values['runs'].items()},
        duration=duration,
        film=divs.pop('film'),
        gg=divs.pop('gg'),
        panels=divs,
        lines=table.lines(material.values['runs']),
        paper_note=table.PAPER_NOTE,
        good=GOOD,
        claims=material.claims,
        reasons={key: text for one in material.claims for key, text in one.reasons.items()},
        origin=provenance.origin(infos),
        parameters=provenance.parameters(infos),
        bokeh_js='\n'.join(Resources(mode='inline', components=['bokeh']).js_raw),
        bokeh_script=script,
        style=(PAGE / 'report.css').read_text(),
        script=(PAGE / 'report.js').read_text(),
    )


def _embedded(view, panels):
    """Return the script that holds every figure, and an element for each by its name."""
    document = Document()
    # one walk through all models instead of one per figure
    with document.models.freeze():
        for plot in (view.plot, *panels):
            document.add_root(plot)
    arguments = {'film': view._asdict(), 'panels': panels}
    document.js_on_event('document_ready', CustomJS(args=arguments, code=START))
    return components({plot.name: plot for plot in (view.plot, *panels)}, wrap_script=False)


def _template():
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    environment.trim_blocks = environment.lstrip_blocks = True
    return environment.from_string((PAGE / 'report.html').read_text())
