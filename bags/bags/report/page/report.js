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
    candidates: get(run, 'candidates'), flag: get(run, 'flag'), pole: get(run, 'pole'),
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

  // The name of each car that is shown in a row of its own at the top, and a line from there to the
  // car: so cars in one place are told apart. There is room for so many.
  const FLAG_PX = 18, MOST_FLAGS = Number(slider.dataset.flags);
  const hidden = new Set(); // names of runs
  function drawFlags(t) {
    const shown = runs.filter((run) => !hidden.has(run.name));
    const flagged = shown.length > MOST_FLAGS ? [] : shown;
    for (const run of runs.filter((one) => !flagged.includes(one))) {
      if (!get(run.pole.data, 'x').length) continue;
      run.flag.data = { x: [], y: [], text: [] };
      run.pole.data = { x: [], y: [] };
    }
    const { x_range, y_range } = plot;
    const perPixelX = (x_range.end - x_range.start) / (plot.inner_width || 1000);
    const perPixelY = (y_range.end - y_range.start) / (plot.inner_height || 200);
    flagged.forEach((run, k) => {
      const at = pose(run.car, t), half = get(run.car, 'width') / 2;
      const room = (4 * run.name.length + 8) * perPixelX;
      const x = Math.min(Math.max(at.x, x_range.start + room), x_range.end - room);
      const y = y_range.end - (k + 0.5) * FLAG_PX * perPixelY;
      run.flag.data = { x: [x], y: [y], text: [run.name] };
      run.pole.data = { x: [x, at.x], y: [y - 0.4 * FLAG_PX * perPixelY, at.y + half] };
    });
  }

  // How much larger Y is drawn than X: it depends on the screen.
  const stretchText = element('stretch');
  function sayStretch() {
    const { x_range, y_range, inner_width, inner_height } = plot;
    if (!inner_width || !inner_height) return;
    const ratio = (inner_height / (y_range.end - y_range.start)) / (inner_width / (x_range.end - x_range.start));
    const text = Math.abs(ratio - 1) < 0.03 ? 'X and Y have equal scales.'
      : ratio > 1 ? `Y is drawn ${ratio.toFixed(1)} times larger than X.`
        : `X is drawn ${(1 / ratio).toFixed(1)} times larger than Y.`;
    if (stretchText.textContent !== text) stretchText.textContent = text;
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
  const NARROW_PX = 700; // of a screen on which the whole road would be far out of proportion
  const WINDOW_M = innerWidth < NARROW_PX ? 30 : 70, BEHIND = 0.3;
  let followed = null;
  function look(t) {
    if (!followed) return;
    const at = pose(followed.car, t);
    const size = document.querySelector('.film').getBoundingClientRect();
    const width = plot.inner_width || size.width, drawn = plot.inner_height || size.height;
    const height = WINDOW_M * drawn / width;
    // the names of the cars are above the road
    const rows = Math.min(runs.length, MOST_FLAGS);
    const low = at.y - (height - rows * FLAG_PX * height / drawn) / 2;
    plot.x_range.setv({ start: at.x - BEHIND * WINDOW_M, end: at.x + (1 - BEHIND) * WINDOW_M });
    plot.y_range.setv({ start: low, end: low + height });
  }
  element('view').addEventListener('change', (event) => {
    followed = runs.find((run) => run.name === event.target.value) || null;
    if (!followed) {
      plot.x_range.setv({ start: whole.x[0], end: whole.x[1] });
      plot.y_range.setv({ start: whole.y[0], end: whole.y[1] });
    }
    show(now);
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
    drawFlags(now);
    sayStretch();
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
  let untouched = true; // the film opens at a telling moment, and plays from the start
  function start() {
    if (untouched || now >= duration) show(0);
    untouched = false;
    playing = true;
    last = null;
    play.textContent = 'Pause';
    play.setAttribute('aria-pressed', 'true');
    requestAnimationFrame(frame);
  }
  play.addEventListener('click', () => (playing ? pause() : start()));
  slider.addEventListener('input', () => {
    untouched = false;
    show(Number(slider.value));
  });
  document.addEventListener('keydown', (event) => {
    const busy = event.target.closest('button, input, select, summary, a, [tabindex]');
    if (busy || event.ctrlKey || event.metaKey || event.altKey) return;
    const steps = { ArrowLeft: -0.05, ArrowRight: 0.05 };
    if (event.key === ' ') play.click();
    else if (event.key in steps) {
      untouched = false;
      show(now + steps[event.key]);
    } else return;
    event.preventDefault();
  });

  // What is drawn of a run carries its tag.
  for (const box of document.querySelectorAll('[data-run]')) {
    box.addEventListener('change', () => {
      for (const one of plots.flatMap((each) => each.renderers)) {
        if (one.tags.includes(`run:${box.dataset.run}`)) one.visible = box.checked;
      }
      for (const item of document.querySelectorAll(`[data-key="${CSS.escape(box.dataset.run)}"]`)) {
        item.hidden = !box.checked;
      }
      if (box.checked) hidden.delete(box.dataset.run); else hidden.add(box.dataset.run);
      drawFlags(now);
    });
  }
  for (const button of document.querySelectorAll('[data-show]')) {
    button.addEventListener('click', () => {
      for (const box of document.querySelectorAll('[data-run]')) {
        box.checked = button.dataset.show === 'all';
        box.dispatchEvent(new Event('change'));
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
    // an overlay may not know its station, or its time
    const ends = curves.map((one) => one.data_source.data[name])
      .map((v) => [v[0], v[v.length - 1]]).filter((e) => e.every(Number.isFinite));
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
  if (innerWidth < NARROW_PX) {
    element('view').value = runs[0].name;
    followed = runs[0];
  }
  show(Number(slider.value));
  for (const name of ['inner_width', 'inner_height']) {
    plot.properties[name].change.connect(() => show(now));
  }
  plot.x_range.properties.start.change.connect(() => sayStretch());
  document.documentElement.dataset.ready = 'yes';
}
