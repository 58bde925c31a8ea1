"""The report as a reader sees it: in headless Chromium, played and zoomed, without a network."""

import pytest

from bags.figures import panels, style
from bags.figures.panels import PANELS
from bags.report import page

pytestmark = pytest.mark.slow
INK = """const ink = (() => {
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
})();"""
# what a reader does, and what is shown
PAGE = """
const roots = Bokeh.documents[0].roots();
const element = (name) => document.getElementById(name);
const click = (selector) => document.querySelector(selector).click();
const choose = (name, value, event = 'input') => {
  element(name).value = value;
  element(name).dispatchEvent(new Event(event));
};
const now = () => Number(document.documentElement.dataset.time);
const sizes = () => [document.documentElement.scrollWidth, innerWidth];
const linked = () => roots.slice(1).filter((one) => one.name !== 'gg')
  .map((one) => [one.x_range.start, one.x_range.end]);
const bodies = () => roots[0].renderers
  .filter((one) => one.glyph.type === 'Patch' && one.tags.length)
  .map((one) => [Array.from(one.data_source.data.x), Array.from(one.data_source.data.y)]);
// of the cars that have one above the road
const names = () => roots[0].renderers
  .flatMap((one) => one.data_source.data.text || []).filter((one) => one);
"""


@pytest.mark.parametrize(('width', 'dark'), [(360, True), (1200, False)])
def test_every_panel_is_drawn_and_nothing_complains(report, browse, width, dark):
    script = f'{PAGE} await until(() => Bokeh.documents[0].is_idle); {INK} return [ink, sizes()];'
    (ink, (page_width, screen)), complaints = browse(report, script, width, dark)
    assert complaints == []
    assert set(ink) == {one.name for one in PANELS} | {'gg', 'film'}
    for name, (drawn_width, pixels) in ink.items():
        assert 0 < drawn_width <= width, name
        assert pixels > 1000, name
    assert page_width <= screen == width, 'the page scrolls sideways'


PLAYED = """
const opening = Number(element('time').defaultValue);
element('rate').value = '0.1';  // slow, so that it does not end before it is paused
const before = JSON.stringify(bodies());
element('play').click();
await until(() => now() > 0 && now() < opening);
const moved = JSON.stringify(bodies()) !== before;
element('play').click();
const paused = now();
await new Promise((done) => setTimeout(done, 300));
const still = now();
element('rate').value = '2';
element('play').click();
await until(() => element('play').textContent === 'Play');
const end = now();
choose('time', 2.5);
return [moved, paused, still, end, bodies()];
"""


def test_the_film_plays_to_its_end_and_puts_every_car_where_the_bag_says(report, browse, runs):
    (moved, paused, still, end, bodies), complaints = browse(report, PAGE + PLAYED)
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


ZOOMED = """
roots[1].x_range.setv({ start: 1, end: 2 });
const zoomed = linked();
choose('axis', 'station', 'change');
const fields = roots.slice(1).flatMap((one) => one.renderers)
  .filter((one) => one.tags.includes('curve')).map((one) => one.glyph.x.field);
const stations = linked();
click('[data-run="own"]');
const shown = roots.flatMap((one) => one.renderers)
  .filter((one) => one.visible).flatMap((one) => one.tags);
choose('view', 'mpcc', 'change');
choose('time', 4);
return [zoomed, fields, stations, shown, roots[0].x_range.start, roots[0].x_range.end];
"""


def test_zooming_one_panel_zooms_all_and_a_run_can_be_hidden_and_followed(report, browse):
    (zoomed, fields, stations, shown, low, high), complaints = browse(report, PAGE + ZOOMED)
    assert complaints == []
    assert zoomed == [[1, 2]] * len(PANELS)
    assert set(fields) == {'station'}
    assert stations[0] == pytest.approx([0.0, 100.0], abs=0.5)
    assert 'run:own' not in shown
    assert 'run:mpcc' in shown
    assert low < 80.0 < high
    assert high - low == pytest.approx(70.0)


CHOSEN = """
await until(() => Bokeh.documents[0].is_idle);
const seen = [names()];
for (const selector of ['[data-show=none]', '[data-run="own@07"]', '[data-show=all]']) {
  click(selector);
  seen.push(names());
}
document.querySelector('.metrics').parentElement.scrollLeft = 500;
const row = document.querySelector('.metrics tbody th').getBoundingClientRect().left;
return [seen, sizes(), row];
"""


def test_of_many_runs_those_that_are_chosen_are_named_above_the_road(
    material, runs, browse, tmp_path
):
    many = panels.assign({f'own@{k:02d}': runs[1] for k in range(style.MANY + 1)})
    values = {run.name: material['runs']['own'] for run in many}
    file = tmp_path / page.REPORT_FILE
    file.write_text(page.report_html({'scenario': 'straight', 'runs': values}, many))
    (seen, (page_width, screen), left), complaints = browse(file, PAGE + CHOSEN)
    assert complaints == []
    assert seen == [[], [], ['own@07'], []]
    assert page_width <= screen
    assert 0 <= left < 100, 'the names of the rows scroll away'
