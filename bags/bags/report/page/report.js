'use strict';
// Sets the figures of the report in motion. Everything is drawn by Bokeh from its sources; this
// script only says which of the recorded numbers they show. Called once, when Bokeh is ready.
function startReport(film, panels) {
  const element = (id) => document.getElementById(id);
  const slider = element('time'), play = element('play'), clock = element('clock');
  const duration = Number(slider.max);
  const get = (holder, key) => (holder instanceof Map ? holder.get(key) : holder[key]);
  const runs = Array.from(get(film, 'runs'), (run) => ({
    name: get(run, 'name'), car: get(run, 'car'), plan: get(run, 'plan'), body: get(run, 'body'),
    circles: get(run, 'circles'), horizon: get(run, 'horizon'), others: get(run, 'others'),
    candidates: get(run, 'candidates'),
  }));
  const plot = get(film, 'plot'), obstacles = get(film, 'obstacles'), places = get(film, 'places');
  const plots = [plot, ...panels];

  const row = (table, k, width) => Array.from({ length: width }, (_, i) => table[k * width + i]);

  // Where t lies in a sorted array: the last index at or before it, 0 before the first.
  function before(times, t) {
    let low = 0, high = times.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (times[middle] <= t + 1e-6) low = middle; else high = middle - 1;
    }
    return low;
  }

  // The numbers of a car at t, between two frames.
  function pose(car, t) {
    const times = get(car, 't'), k = before(times, t);
    const next = Math.min(k + 1, times.length - 1);
    const share = next > k ? Math.min(Math.max((t - times[k]) / (times[next] - times[k]), 0), 1) : 0;
    const mixed = (name) => {
      const values = get(car, name);
      return values[k] + share * (values[next] - values[k]);
    };
    return { x: mixed('x'), y: mixed('y'), yaw: mixed('yaw'), speed: mixed('speed'),
      station: mixed('station') };
  }

  function placed(at, ahead, left) {
    const c = Math.cos(at.yaw), s = Math.sin(at.yaw);
    return [at.x + c * ahead - s * left, at.y + s * ahead + c * left];
  }

  const unzip = (points) => ({ x: points.map((p) => p[0]), y: points.map((p) => p[1]) });

  function drawCar(run, t) {
    const front = get(run.car, 'front'), rear = get(run.car, 'rear');
    const half = get(run.car, 'width') / 2, at = pose(run.car, t);
    // the front is bevelled: one sees where the car points
    const outline = [[-rear, half], [front - half, half], [front, half / 2], [front, -half / 2],
      [front - half, -half], [-rear, -half]];
    run.body.data = unzip(outline.map(([ahead, left]) => placed(at, ahead, left)));
    const offsets = Array.from(get(run.car, 'circles'));
    const width = offsets.map(() => 2 * get(run.car, 'radius'));
    run.circles.data = { ...unzip(offsets.map((ahead) => placed(at, ahead, 0))), width };
    const ended = t > get(run.car, 'end') ? ', ended' : '';
    document.querySelector(`[data-speed="${CSS.escape(run.name)}"]`).textContent =
      `${at.speed.toFixed(1)} m/s${ended}`;
  }

  // The plan that is driven, and those that were compared with it.
  function drawPlans(run, t) {
    drawRow(run.plan, run.horizon, t);
    drawRow(run.others, run.candidates, t);
  }

  function drawRow(table, source, t) {
    const times = get(table, 't');
    if (!times.length || t < times[0] - 1e-6) {
      source.data = { x: [], y: [] };
      return;
    }
    const x = get(table, 'x'), y = get(table, 'y');
    const width = x.length / times.length, k = before(times, t);
    source.data = { x: row(x, k, width), y: row(y, k, width) };
  }

  function drawObstacles(t) {
    if (!places) return;
    const times = get(obstacles, 't'), k = before(times, t);
    const x = get(obstacles, 'x'), y = get(obstacles, 'y'), width = x.length / times.length;
    places.data = { ...places.data, x: row(x, k, width), y: row(y, k, width) };
  }

  // Views of the film: the whole road, or a window around one car with equal scales.
  const whole = { x: [plot.x_range.start, plot.x_range.end], y: [plot.y_range.start, plot.y_range.end] };
  const WINDOW_M = 70, BEHIND = 0.3;
  let followed = null;
  function look(t) {
    if (!followed) return;
    const at = pose(followed.car, t);
    const size = document.querySelector('.film').getBoundingClientRect();
    const height = WINDOW_M * size.height / size.width;
    plot.x_range.setv({ start: at.x - BEHIND * WINDOW_M, end: at.x + (1 - BEHIND) * WINDOW_M });
    plot.y_range.setv({ start: at.y - height / 2, end: at.y + height / 2 });
  }
  element('view').addEventListener('change', (event) => {
    followed = runs.find((run) => run.name === event.target.value) || null;
    if (followed) look(now);
    else {
      plot.x_range.setv({ start: whole.x[0], end: whole.x[1] });
      plot.y_range.setv({ start: whole.y[0], end: whole.y[1] });
    }
  });

  let now = 0, playing = false, last = null, cursorDrawn = -Infinity;
  const cursors = panels.flatMap((panel) => panel.center.filter((one) => one.name === 'cursor'));
  const CURSOR_MS = 100; // the panels are repainted that often while the film plays
  function drawCursors(force) {
    const moment = performance.now();
    if (!force && moment - cursorDrawn < CURSOR_MS) return;
    cursorDrawn = moment;
    const leader = followed || runs[0];
    const where = element('axis').value === 'time' ? now : pose(leader.car, now).station;
    for (const cursor of cursors) cursor.location = where;
  }

  function show(t, force = true) {
    now = Math.min(Math.max(t, 0), duration);
    for (const run of runs) {
      drawCar(run, now);
      drawPlans(run, now);
    }
    drawObstacles(now);
    look(now);
    drawCursors(force);
    slider.value = now;
    clock.textContent = `${now.toFixed(2)} s`;
    document.documentElement.dataset.time = now.toFixed(3);
  }

  function frame(moment) {
    if (!playing) return;
    if (last !== null) show(now + (moment - last) / 1000 * Number(element('rate').value), false);
    last = moment;
    if (now >= duration) pause();
    else requestAnimationFrame(frame);
  }
  function pause() {
    playing = false;
    play.textContent = 'Play';
    play.setAttribute('aria-pressed', 'false');
    show(now);
  }
  function start() {
    if (now >= duration) show(0);
    playing = true;
    last = null;
    play.textContent = 'Pause';
    play.setAttribute('aria-pressed', 'true');
    requestAnimationFrame(frame);
  }
  play.addEventListener('click', () => (playing ? pause() : start()));
  slider.addEventListener('input', () => show(Number(slider.value)));
  document.addEventListener('keydown', (event) => {
    const busy = event.target.closest('button, input, select, summary, a, [tabindex]');
    if (busy || event.ctrlKey || event.metaKey || event.altKey) return;
    const steps = { ArrowLeft: -0.05, ArrowRight: 0.05 };
    if (event.key === ' ') play.click();
    else if (event.key in steps) show(now + steps[event.key]);
    else return;
    event.preventDefault();
  });

  // What is drawn of a run carries its tag.
  for (const box of document.querySelectorAll('[data-run]')) {
    box.addEventListener('change', () => {
      for (const one of plots.flatMap((each) => each.renderers)) {
        if (one.tags.includes(`run:${box.dataset.run}`)) one.visible = box.checked;
      }
    });
  }

  element('axis').addEventListener('change', (event) => {
    const name = event.target.value, curves = [];
    for (const panel of panels) {
      const mine = panel.renderers.filter((one) => one.tags.includes('curve'));
      for (const one of mine) one.glyph.x = { field: name };
      if (mine.length) panel.below[0].axis_label = name === 'time' ? 'time [s]' : 'station [m]';
      curves.push(...mine);
    }
    const ends = curves.flatMap((one) => [one.data_source.data[name]].map((v) => [v[0], v[v.length - 1]]));
    const linked = panels[0].x_range;
    const bounds = { start: Math.min(...ends.map((e) => e[0])), end: Math.max(...ends.map((e) => e[1])) };
    linked.setv({ ...bounds, reset_start: bounds.start, reset_end: bounds.end });
    drawCursors(true);
  });

  // On a screen that is touched, dragging scrolls the page.
  if (matchMedia('(pointer: coarse)').matches) {
    for (const each of plots) {
      each.toolbar.tools.filter((tool) => tool.type === 'BoxZoomTool' || tool.type === 'PanTool')
        .forEach((tool) => { tool.active = false; });
    }
  }
  show(0);
  document.documentElement.dataset.ready = 'yes';
}
