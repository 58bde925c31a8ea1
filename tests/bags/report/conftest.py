"""A report of two short drives, and a headless Chromium to look at it with."""

import asyncio
import itertools
import json
import os
import subprocess

import numpy as np
import pytest
from capabilities import chromium, require
from evaluated_drives import evaluate_runs
from straight_drive import obstacle, straight_scene
from tornado.httpclient import AsyncHTTPClient
from tornado.websocket import websocket_connect

from bags.evaluation import metrics
from bags.report import page
from bags.storage.columns import Columns
from msgs_yaml.types import Prediction, Why

SECONDS = 60.0
FLAGS = (
    '--headless',
    '--no-sandbox',
    '--disable-gpu',
    '--no-first-run',
    '--disable-background-networking',
    '--remote-debugging-port=0',
    # the report must not need a network: there is none
    '--host-resolver-rules=MAP * ~NOTFOUND',
)


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


class Tab:
    """A page in the browser, over the DevTools protocol."""

    def __init__(self, socket):
        self.socket = socket
        self.numbers = itertools.count(1)
        self.events = []

    async def call(self, method, **params):
        number = next(self.numbers)
        await self.socket.write_message(
            json.dumps({'id': number, 'method': method, 'params': params})
        )
        while True:
            said = json.loads(await asyncio.wait_for(self.socket.read_message(), SECONDS))
            if said.get('id') == number:
                assert 'error' not in said, said
                return said['result']
            self.events.append(said)

    async def value(self, expression):
        """Evaluate JavaScript and return its value."""
        options = {'returnByValue': True, 'awaitPromise': True}
        found = await self.call('Runtime.evaluate', expression=expression, **options)
        assert 'exceptionDetails' not in found, found
        return found['result'].get('value')

    async def until(self, expression):
        for _ in range(int(SECONDS / 0.05)):
            if await self.value(expression):
                return
            await asyncio.sleep(0.05)
        raise AssertionError(f'never true: {expression}')

    def complaints(self):
        """Return errors and warnings of the console, exceptions, requests to a network."""
        result = []
        for event in self.events:
            method, params = event['method'], event['params']
            if method == 'Runtime.exceptionThrown':
                result.append(params['exceptionDetails'])
            if method == 'Runtime.consoleAPICalled' and params['type'] in ('error', 'warning'):
                result.append(params['args'])
            if method == 'Log.entryAdded' and params['entry']['level'] in ('error', 'warning'):
                result.append(params['entry'])
            if method == 'Network.requestWillBeSent':
                url = params['request']['url']
                if not url.startswith(('file:', 'data:', 'blob:')):
                    result.append(url)
        return result


@pytest.fixture(scope='session')
def browse(tmp_path_factory):
    """Return browse(file, visit, width): open a page, run the coroutine visit(tab), return."""
    require('chromium')
    folder = tmp_path_factory.mktemp('chromium')
    log = folder / 'log'
    with log.open('w') as out:
        process = subprocess.Popen(
            [chromium(), *FLAGS, f'--user-data-dir={folder}', 'about:blank'],
            stdout=out,
            stderr=out,
            env={**os.environ, 'HOME': str(folder)},
        )

    def run(file, visit, width=1200, dark=False):
        return asyncio.run(asyncio.wait_for(_visit(folder, log, file, visit, width, dark), SECONDS))

    yield run
    process.terminate()
    try:
        process.wait(60)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


async def _visit(folder, log, file, visit, width, dark):
    port = folder / 'DevToolsActivePort'
    for _ in range(int(SECONDS / 0.05)):
        if port.exists() and port.read_text().count('\n'):
            break
        await asyncio.sleep(0.05)
    else:
        raise AssertionError(f'Chromium did not start: {log.read_text()}')
    url = f'http://127.0.0.1:{port.read_text().split()[0]}/json/new?about:blank'
    answer = await AsyncHTTPClient().fetch(url, method='PUT', body=b'')
    target = json.loads(answer.body)
    socket = await websocket_connect(target['webSocketDebuggerUrl'], max_message_size=1 << 26)
    tab = Tab(socket)
    for domain in ('Runtime', 'Log', 'Network', 'Page'):
        await tab.call(f'{domain}.enable')
    await tab.call(
        'Emulation.setDeviceMetricsOverride',
        width=width,
        height=900,
        deviceScaleFactor=1,
        mobile=width < 600,
    )
    scheme = {'name': 'prefers-color-scheme', 'value': 'dark' if dark else 'light'}
    await tab.call('Emulation.setEmulatedMedia', features=[scheme])
    await tab.call('Page.navigate', url=file.as_uri())
    await tab.until("document.documentElement?.dataset.ready === 'yes'")
    try:
        return await visit(tab)
    finally:
        await tab.call('Page.close')
        socket.close()
