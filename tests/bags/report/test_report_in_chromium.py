"""The report as a reader sees it: in headless Chromium, played and zoomed, without a network."""

import pytest
from evaluated_drives import evaluate_runs

from bags.evaluation import metrics
from bags.report import page
from bags.report.interactive_panels import PANELS

pytestmark = pytest.mark.slow
PANEL_NAMES = {one.name for one in PANELS} | {'gg'}
INK = """(() => {
  const found = {};
  for (const plot of document.querySelectorAll('[data-panel], .film')) {
    const name = plot.dataset.panel || 'film';
    const figures = [...plot.querySelectorAll('*')].filter((one) => one.shadowRoot);
    const canvases = [];
    const search = (root) => {
      for (const one of root.querySelectorAll('*')) {
        if (one.tagName === 'CANVAS') canvases.push(one);
        if (one.shadowRoot) search(one.shadowRoot);
      }
    };
    search(plot);
    let ink = 0;
    for (const canvas of canvases) {
      const { width, height } = canvas;
      const data = canvas.getContext('2d').getImageData(0, 0, width, height).data;
      for (let i = 3; i < data.length; i += 4) ink += data[i] > 0;
    }
    found[name] = [canvases.length && canvases[0].getBoundingClientRect().width, ink];
  }
  return found;
})()"""
# of the cars that have one above the road
NAMES = """Bokeh.documents[0].roots()[0].renderers.flatMap((one) => one.data_source.data.text || [])
  .filter((one) => one)"""
CHOICE = """document.querySelector('[data-run="own@07"]')"""
ROW_NAME = "document.querySelector('.metrics tbody th')"
NOW = 'Number(document.documentElement.dataset.time)'
OPENING = "Number(document.getElementById('time').defaultValue)"
BODY = 'Bokeh.documents[0].roots()[0].renderers.map((one) => one.data_source.data.x)'


@pytest.mark.parametrize(('width', 'dark'), [(360, True), (1200, False)])
def test_every_panel_is_drawn_and_nothing_complains(report, browse, width, dark):
    async def visit(tab):
        await tab.until('Bokeh.documents[0].is_idle')
        return await tab.value(INK), await tab.value(
            '[document.documentElement.scrollWidth, innerWidth]'
        ), tab.complaints()  # fmt: skip

    ink, (page_width, screen), complaints = browse(report, visit, width, dark)
    assert complaints == []
    assert set(ink) == PANEL_NAMES | {'film'}
    for name, (drawn_width, pixels) in ink.items():
        assert 0 < drawn_width <= width, name
        assert pixels > 1000, name
    assert page_width <= screen, 'the page scrolls sideways'


def test_the_film_plays_to_its_end_and_the_car_moves(report, browse):
    async def visit(tab):
        # slow, so that it does not end before it is paused
        await tab.value("document.getElementById('rate').value = '0.1'")
        before = await tab.value(BODY)
        await tab.value("document.getElementById('play').click()")
        await tab.until(f'{NOW} > 0 && {NOW} < {OPENING}')
        between = await tab.value(BODY)
        await tab.value("document.getElementById('play').click()")
        paused = await tab.value(NOW)
        still = await tab.value(f'new Promise((done) => setTimeout(() => done({NOW}), 300))')
        await tab.value("document.getElementById('rate').value = '2'")
        await tab.value("document.getElementById('play').click()")
        await tab.until("document.getElementById('play').textContent === 'Play'")
        return before, between, paused, still, await tab.value(NOW), tab.complaints()

    before, between, paused, still, end, complaints = browse(report, visit)
    assert complaints == []
    assert before != between
    assert paused == still > 0.0
    assert end == pytest.approx(5.0, abs=0.02)


def test_the_slider_puts_every_car_where_the_bag_says(report, browse, runs):
    async def visit(tab):
        await tab.value(
            "(() => { const s = document.getElementById('time'); s.value = 2.5;"
            "s.dispatchEvent(new Event('input')); })()"
        )
        return await tab.value(
            'Bokeh.documents[0].roots()[0].renderers.filter((one) => one.glyph.type === "Patch"'
            ' && one.tags.length).map((one) => [Array.from(one.data_source.data.x),'
            ' Array.from(one.data_source.data.y)])'
        )

    bodies = browse(report, visit)
    assert len(bodies) == len(runs)
    for run, (x, y) in zip(runs, bodies):
        k = 2500
        outline = run.drive.facts.outline
        assert max(x) == pytest.approx(run.drive.motion.x[k] + outline.front, abs=0.01)
        assert min(x) == pytest.approx(run.drive.motion.x[k] - outline.rear, abs=0.01)
        middle = (max(y) + min(y)) / 2
        assert middle == pytest.approx(run.drive.motion.y[k], abs=0.01)
        assert max(y) - min(y) == pytest.approx(outline.width, abs=0.01)


def test_zooming_one_panel_zooms_all_and_the_axis_can_be_the_station(report, browse):
    linked = (
        'Bokeh.documents[0].roots().slice(1).filter((one) => one.name !== "gg")'
        '.map((one) => [one.x_range.start, one.x_range.end])'
    )

    async def visit(tab):
        await tab.value('void Bokeh.documents[0].roots()[1].x_range.setv({start: 1, end: 2})')
        zoomed = await tab.value(linked)
        await tab.value(
            "(() => { const s = document.getElementById('axis'); s.value = 'station';"
            "s.dispatchEvent(new Event('change')); })()"
        )
        fields = await tab.value(
            'Bokeh.documents[0].roots().slice(1).flatMap((one) => one.renderers)'
            '.filter((one) => one.tags.includes("curve")).map((one) => one.glyph.x.field)'
        )
        return zoomed, fields, await tab.value(linked), tab.complaints()

    zoomed, fields, stations, complaints = browse(report, visit)
    assert zoomed == [[1, 2]] * len(PANELS)
    assert set(fields) == {'station'}
    low, high = stations[0]
    assert (low, high) == pytest.approx((0.0, 100.0), abs=0.5)
    assert complaints == []


def test_a_run_can_be_hidden_and_followed(report, browse):
    async def visit(tab):
        await tab.value('document.querySelector(\'[data-run="own"]\').click()')
        shown = await tab.value(
            'Bokeh.documents[0].roots().flatMap((one) => one.renderers)'
            '.filter((one) => one.visible).flatMap((one) => one.tags)'
        )
        await tab.value(
            "(() => { const s = document.getElementById('view'); s.value = 'mpcc';"
            "s.dispatchEvent(new Event('change')); })()"
        )
        await tab.value("document.getElementById('time').value = 4")
        await tab.value("void document.getElementById('time').dispatchEvent(new Event('input'))")
        span = 'const r = Bokeh.documents[0].roots()[0]'
        window = await tab.value(
            f'(() => {{ {span}; return [r.x_range.start, r.x_range.end]; }})()'
        )
        return shown, window, tab.complaints()

    shown, (low, high), complaints = browse(report, visit)
    assert 'run:own' not in shown
    assert 'run:mpcc' in shown
    assert low < 80.0 < high
    assert high - low == pytest.approx(70.0)
    assert complaints == []


def test_of_many_runs_those_that_are_chosen_are_named_above_the_road(
    drives, logs, browse, tmp_path
):
    many = {f'own@{k:02d}': drives['own'] for k in range(30)}
    runs = evaluate_runs(many)
    values = {run.name: metrics.compute_metrics(run.drive, run.series) for run in runs}
    for run in runs:
        run.log = logs['own']
    data = page.ReportData({'scenario': 'straight', 'runs': values}, runs)
    file = tmp_path / page.REPORT_FILE
    file.write_text(page.report_html(data))

    async def visit(tab):
        await tab.until('Bokeh.documents[0].is_idle')
        found = [await tab.value(NAMES)]
        await tab.value("document.querySelector('[data-show=none]').click()")
        await tab.value(f'{CHOICE}.click()')
        found.append(await tab.value(NAMES))
        await tab.value("document.querySelector('[data-show=all]').click()")
        found.append(await tab.value(NAMES))
        sizes = await tab.value('[document.documentElement.scrollWidth, innerWidth]')
        await tab.value("document.querySelector('.metrics').parentElement.scrollLeft = 500")
        left = await tab.value(f'{ROW_NAME}.getBoundingClientRect().left')
        return found, sizes, left, tab.complaints()

    found, (page_width, screen), left, complaints = browse(file, visit, 1200)
    assert complaints == []
    assert found == [[], ['own@07'], []]
    assert page_width <= screen
    assert 0 <= left < 100, 'the names of the rows scroll away'
