"""The report as a file: self-contained, small, escaped, complete."""

import copy
import re
import time

import markupsafe
import numpy as np
import pytest

from bags.evaluation import metrics
from bags.evaluation.drive import PREDICTION
from bags.figures.comparison_figures import PANELS
from bags.report import page
from bags.report.comparability import (
    UNKNOWN,
    describe_runs,
    origin_rows,
    parameter_rows,
)
from node_runtime import provenance

LIMIT_BYTES = 5_000_000


def changed(run, **others):
    """Return a copy of a run with other attributes."""
    other = copy.copy(run)
    vars(other).update(others)
    return other


def test_it_fetches_nothing_and_is_small(report):
    text = report.read_text()
    assert len(text.encode()) < LIMIT_BYTES
    assert not re.findall(r'<(?:script|link|img)[^>]*(?:src|href)="(?!data:|#)[^"]*"', text)
    assert not re.findall(r'@import|url\((?!data:)', page.PAGE.joinpath('report.css').read_text())


def test_names_and_notes_of_a_run_cannot_break_out_of_the_page(material, runs, report):
    evil = '</script><b onclick="x">&'
    run = changed(runs[0], name=evil, run_info={'mode': evil})
    values = {'scenario': evil, 'runs': {evil: material['runs']['mpcc']}}
    text = page.report_html(values, [run])
    assert evil not in text
    assert text.count('</script>') == report.read_text().count('</script>')


def test_every_number_of_the_table_and_what_differs_stands_in_the_page(material, runs, report):
    text = report.read_text()
    for result in material['runs'].values():
        assert f'{result["min_v2o_m"]:.2f}' in text
        assert f'{result["peak_lat_acc_mps2"]:.1f}' in text
    assert 'a &lt;fast&gt; one' in text
    rows = parameter_rows([run.run_info for run in runs])
    unlike = {role: [row.name for row in result if row.differs] for role, result in rows.items()}
    assert unlike == {'controller': ['weight_of'], 'plant': []}
    assert re.search(r'<tr class="differs"><th scope="row">weight_of</th>', text)
    commit = '0123456789abcdef0123456789abcdef01234567-dirty'
    rows = {row.name: row.values for row in origin_rows([{'git_commit': commit}, {}])}
    assert rows['commit'] == ['0123456789-dirty', '–']


def test_a_drive_without_notes_has_a_report_all_the_same(material, runs):
    silent = [changed(run, tables={}, run_info={}) for run in runs]
    text = page.report_html(material, silent)
    assert 'id="manoeuvre"' in text
    assert 'data-panel="v2o"' in text
    # nothing was said of friction use
    assert 'data-panel="friction_front"' not in text


def test_the_film_is_where_the_drive_was(runs):
    t = page.frame_times(runs)
    assert t[-1] >= runs[0].series.t[-1]
    run = runs[0]
    car = page.car_frames(run, t)
    k = np.searchsorted(run.series.t, t[100])
    assert car['x'][100] == pytest.approx(run.drive.motion.x[k], abs=1e-3)
    assert car['y'][100] == pytest.approx(run.drive.motion.y[k], abs=1e-3)
    view = page.build_top_view(runs)
    x = view['obstacles']['x']
    assert x[:, 0] == pytest.approx(60.0)
    assert np.diff(x[:, 1]) == pytest.approx(5.0 * page.FRAME_NS * 1e-9, abs=1e-4)
    assert view['runs'][0]['plan']['x'].shape == (len(run.sent(PREDICTION)), 26)


def test_every_plot_has_its_unit_and_a_key_with_every_run(runs, report):
    for panel in PANELS:
        assert '[' in panel.axis or panel.axis == 'F / µF_z'
    figures = report.read_text().split('<figure>')[1:]
    assert len(figures) == len(PANELS) + 1
    for figure in figures:
        key = figure.partition('</figure>')[0]
        for run in runs:
            assert f'data-key="{run.name}"' in key
            assert f'stroke="{run.look.colour}"' in key
        if re.search('data-panel="v2[oe]', figure):
            assert 'within the safety distance' in key


def test_every_metric_and_its_meaning_stand_in_the_glossary(report):
    glossary = report.read_text().partition('id="glossary"')[2].partition('</details>')[0]
    for name, metric in metrics.METRICS.items():
        assert f'<code>{name}</code>' in glossary
        assert str(markupsafe.escape(metric.meaning)) in glossary


def test_scenario_and_controllers_are_described_where_the_bag_does_in_seconds(material, runs):
    info = {
        'scenario_text': 'name: s\ndescription: Two cars < one road.\n',
        'controller_description': provenance.leading_comment(
            '# A first line\n# and a second.\nbase: x\n'
        ),
    }
    told = [changed(run, run_info=info) for run in runs]
    start = time.process_time()
    text = page.report_html(material, told)
    assert time.process_time() - start < 5.0
    assert '<p class="lead">Two cars &lt; one road.</p>' in text
    assert text.count('<dd>A first line and a second.</dd>') == len(runs)
    for broken in ('a: [', 'no mapping', ''):
        assert describe_runs(['mpcc'], [{'scenario_text': broken}])['scenario'] == UNKNOWN


def test_the_film_opens_where_the_runs_are_closest_to_an_obstacle(runs):
    nearest = {run.name: np.fmin.reduce(list(run.series.v2o.values())) for run in runs}
    first = min(runs, key=lambda run: np.nanmin(nearest[run.name]))
    wanted = first.series.t[np.nanargmin(nearest[first.name])]
    assert page.opening_time(runs) == wanted > 0.0
