"""The report as a reader sees it: in headless Chromium, played and zoomed, without a network."""

import pytest

from bags.figures import style
from bags.figures.comparison_figures import PANELS
from bags.report import page

pytestmark = pytest.mark.slow
INK = """(() => {
  const found = {};
  for (const plot of document.querySelectorAll('[data-panel], .film')) {
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
    const width = canvases.length && canvases[0].getBoundingClientRect().width;
    found[plot.dataset.panel || 'film'] = [width, ink];
  }
  return found;
})()"""
ROOTS = 'Bokeh.documents[0].roots()'
LINKED = f"""{ROOTS}.slice(1).filter((one) => one.name !== "gg")
  .map((one) => [one.x_range.start, one.x_range.end])"""
# of the cars that have one above the road
NAMES = f'{ROOTS}[0].renderers.flatMap((one) => one.data_source.data.text || []).filter((o) => o)'
BODIES = f"""{ROOTS}[0].renderers.filter((one) => one.glyph.type === "Patch" && one.tags.length)
  .map((one) => [Array.from(one.data_source.data.x), Array.from(one.data_source.data.y)])"""
SIZES = '[document.documentElement.scrollWidth, innerWidth]'
NOW = 'Number(document.documentElement.dataset.time)'
OPENING = "Number(document.getElementById('time').defaultValue)"


def element(name):
    return f"document.getElementById('{name}')"


def choose(name, value, event='input'):
    """Return a script that sets an input of the page as a reader would."""
    return (
        f"(() => {{ const s = {element(name)}; s.value = '{value}';"
        f"s.dispatchEvent(new Event('{event}')); }})()"
    )


@pytest.mark.parametrize(('width', 'dark'), [(360, True), (1200, False)])
def test_every_panel_is_drawn_and_nothing_complains(report, browse, width, dark):
    async def visit(tab):
        await tab.until('Bokeh.documents[0].is_idle')
        return await tab.value(INK), await tab.value(SIZES), tab.complaints()

    ink, (page_width, screen), complaints = browse(report, visit, width, dark)
    assert complaints == []
    assert set(ink) == {one.name for one in PANELS} | {'gg', 'film'}
    for name, (drawn_width, pixels) in ink.items():
        assert 0 < drawn_width <= width, name
        assert pixels > 1000, name
    assert page_width <= screen, 'the page scrolls sideways'


def test_the_film_plays_to_its_end_and_puts_every_car_where_the_bag_says(report, browse, runs):
    async def visit(tab):
        # slow, so that it does not end before it is paused
        await tab.value(f"{element('rate')}.value = '0.1'")
        before = await tab.value(BODIES)
        await tab.value(f'{element("play")}.click()')
        await tab.until(f'{NOW} > 0 && {NOW} < {OPENING}')
        between = await tab.value(BODIES)
        await tab.value(f'{element("play")}.click()')
        paused = await tab.value(NOW)
        still = await tab.value(f'new Promise((done) => setTimeout(() => done({NOW}), 300))')
        await tab.value(f"{element('rate')}.value = '2'")
        await tab.value(f'{element("play")}.click()')
        await tab.until(f"{element('play')}.textContent === 'Play'")
        end = await tab.value(NOW)
        await tab.value(choose('time', 2.5))
        return before != between, paused, still, end, await tab.value(BODIES), tab.complaints()

    moved, paused, still, end, bodies, complaints = browse(report, visit)
    assert complaints == []
    assert moved
    assert paused == still > 0.0
    assert end == pytest.approx(5.0, abs=0.02)
    assert len(bodies) == len(runs)
    for run, (x, y) in zip(runs, bodies):
        motion, outline, k = run.drive.motion, run.drive.facts.outline, 2500
        assert max(x) == pytest.approx(motion.x[k] + outline.front, abs=0.01)
        assert min(x) == pytest.approx(motion.x[k] - outline.rear, abs=0.01)
        assert (max(y) + min(y)) / 2 == pytest.approx(motion.y[k], abs=0.01)
        assert max(y) - min(y) == pytest.approx(outline.width, abs=0.01)


def test_zooming_one_panel_zooms_all_and_a_run_can_be_hidden_and_followed(report, browse):
    async def visit(tab):
        await tab.value(f'void {ROOTS}[1].x_range.setv({{start: 1, end: 2}})')
        zoomed = await tab.value(LINKED)
        await tab.value(choose('axis', 'station', 'change'))
        fields = await tab.value(
            f'{ROOTS}.slice(1).flatMap((one) => one.renderers)'
            '.filter((one) => one.tags.includes("curve")).map((one) => one.glyph.x.field)'
        )
        stations = await tab.value(LINKED)
        await tab.value('document.querySelector(\'[data-run="own"]\').click()')
        shown = await tab.value(
            f'{ROOTS}.flatMap((one) => one.renderers)'
            '.filter((one) => one.visible).flatMap((one) => one.tags)'
        )
        await tab.value(choose('view', 'mpcc', 'change'))
        await tab.value(choose('time', 4))
        span = await tab.value(f'[{ROOTS}[0].x_range.start, {ROOTS}[0].x_range.end]')
        return zoomed, fields, stations, shown, span, tab.complaints()

    zoomed, fields, stations, shown, (low, high), complaints = browse(report, visit)
    assert complaints == []
    assert zoomed == [[1, 2]] * len(PANELS)
    assert set(fields) == {'station'}
    assert stations[0] == pytest.approx([0.0, 100.0], abs=0.5)
    assert 'run:own' not in shown
    assert 'run:mpcc' in shown
    assert low < 80.0 < high
    assert high - low == pytest.approx(70.0)


def test_of_many_runs_those_that_are_chosen_are_named_above_the_road(
    material, runs, browse, tmp_path
):
    many = style.assign({f'own@{k:02d}': runs[1] for k in range(style.MANY + 1)})
    values = {run.name: material['runs']['own'] for run in many}
    file = tmp_path / page.REPORT_FILE
    file.write_text(page.report_html({'scenario': 'straight', 'runs': values}, many))

    async def visit(tab):
        await tab.until('Bokeh.documents[0].is_idle')
        found = [await tab.value(NAMES)]
        await tab.value("document.querySelector('[data-show=none]').click()")
        await tab.value('document.querySelector(\'[data-run="own@07"]\').click()')
        found.append(await tab.value(NAMES))
        await tab.value("document.querySelector('[data-show=all]').click()")
        found.append(await tab.value(NAMES))
        await tab.value("document.querySelector('.metrics').parentElement.scrollLeft = 500")
        row = "document.querySelector('.metrics tbody th').getBoundingClientRect().left"
        return found, await tab.value(SIZES), await tab.value(row), tab.complaints()

    found, (page_width, screen), left, complaints = browse(file, visit, 1200)
    assert complaints == []
    assert found == [[], ['own@07'], []]
    assert page_width <= screen
    assert 0 <= left < 100, 'the names of the rows scroll away'
