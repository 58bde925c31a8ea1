"""A report of two short drives, and a headless Chromium to look at it with."""

import html
import json
import re
import subprocess

import numpy as np
import pytest
from capabilities import chromium, require
from evaluated_drives import evaluate_runs
from straight_drive import obstacle, straight_scene

from bags.evaluation import metrics
from bags.report import page
from bags.storage.columns import Columns
from msgs_yaml.types import Prediction, Why

SECONDS = 240.0
FLAGS = (
    *('--headless', '--no-sandbox', '--disable-gpu', '--no-first-run'),
    # the report must not need a network: there is none
    *('--disable-background-networking', '--host-resolver-rules=MAP * ~NOTFOUND'),
    # of the page's own time, in which a film plays and a script waits
    '--virtual-time-budget=60000',
)
# before the scripts of the page
HEARD = """<script>
const complaints = [];
addEventListener('error', (event) => complaints.push(event.message));
addEventListener('unhandledrejection', (event) => complaints.push(String(event.reason)));
console.error = console.warn = (...words) => complaints.push(words.join(' '));
</script>"""
VISIT = """<script type="module">
const until = async (isTrue) => {
  while (!isTrue()) await new Promise((done) => setTimeout(done, 20));
};
await until(() => document.documentElement.dataset.ready === 'yes');
const result = await (async () => { SCRIPT })();
const fetched = performance.getEntriesByType('resource').map((one) => one.name);
complaints.push(...fetched.filter((url) => !/^(file|data|blob):/.test(url)));
const output = document.createElement('pre');
output.id = 'result';
output.textContent = JSON.stringify([result, complaints]);
parent.document.body.append(output);
</script>"""


@pytest.fixture(scope='session')
def drives(make_drive):
    """Return two drives past an obstacle that stands and one that moves."""
    scene = straight_scene((obstacle(1, 60.0, -3.5), obstacle(2, 20.0, 4.0, 5.0, radius=0.5)))
    return {
        'mpcc': make_drive(scene=scene, y=lambda x: 0.3 * np.sin(x / 15.0)),
        'own': make_drive(scene=scene, controller='own', force=lambda x: -20.0 * x),
    }


def _sent(one):
    """Return what a controller sends during a drive, as tables."""
    ticks = one.motion.stamp_ns[:-1:50]
    stages, t = np.arange(51) * 0.05, (ticks - ticks[0]) * 1e-9
    predictions = [
        Prediction(int(ns), x + 20.0 * stages, y + 0.0 * stages, 0.0 * stages, stages)
        for ns, x, y in zip(ticks, one.motion.x[::50], one.motion.y[::50])
    ]
    said = {'friction.front': 0.5, 'friction.rear': 0.4, 'time.solve_ms': 2.0}
    reports = [Why(ns, 0, 'solved', said) for ns in ticks.tolist()]
    return {
        '/controller/prediction': Columns(ticks, t, values=predictions),
        '/controller/why': Columns(ticks, t, values=reports),
    }


def _run_info(name):
    own = {'friction': 1.0, 'weight_of': name, 'stop.x_m': 90.0}
    return {
        'mode': 'lockstep',
        'scenario': 'straight',
        'git_commit': '0123abc',
        'parameters': json.dumps({'plant': {'friction': 1.0}, 'controller': own}),
        'versions': json.dumps({'python': '3.11'}),
        'machine': json.dumps({'processor': 'a <fast> one', 'cores': 2}),
    }


@pytest.fixture(scope='session')
def runs(drives):
    made = evaluate_runs(drives)
    for run in made:
        run.tables, run.run_info = _sent(run.drive), _run_info(run.name)
    return made


@pytest.fixture(scope='session')
def material(runs):
    result = {run.name: metrics.metrics_of(run) for run in runs}
    return {'scenario': 'straight', 'runs': result}


@pytest.fixture(scope='session')
def report(material, runs, tmp_path_factory):
    """Return the path of the report."""
    file = tmp_path_factory.mktemp('report') / page.REPORT_FILE
    file.write_text(page.report_html(material, runs))
    return file


@pytest.fixture(scope='session')
def browse(tmp_path_factory):
    """Return browse(file, script, ...): what JavaScript returns on a page, and all complaints.

    These are errors and warnings of the console, exceptions, and requests to a network.
    """
    require('chromium')
    folder = tmp_path_factory.mktemp('chromium')

    def visit(file, script, width=1200, dark=False):
        text = file.read_text().replace('<head>', f'<head>{HEARD}', 1)
        text = text.replace('</body>', VISIT.replace('SCRIPT', script) + '</body>')
        framed = folder / 'page.html'
        # in a frame: a window of Chromium is no narrower than 500 pixels
        frame = f'<iframe width={width} height=900 style="border: 0" srcdoc="{html.escape(text)}">'
        framed.write_text(f'<!doctype html><body>{frame}</iframe></body>')
        scheme = f'--blink-settings=preferredColorScheme={0 if dark else 1}'
        command = [chromium(), *FLAGS, scheme, f'--user-data-dir={folder}']
        command += ['--window-size=1300,1000', '--dump-dom', framed.as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS)
        (result,) = re.findall('<pre id="result">(.*?)</pre>', done.stdout, re.DOTALL)
        return json.loads(html.unescape(result))

    return visit
