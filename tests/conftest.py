"""Fixtures and marks of all tests: a ROS domain per module, capabilities of the machine."""

import gc
import os
import signal
import sys
from collections import Counter

import capabilities
import changes
import commit_seed
import hypothesis
import pytest
import straight_drive
import wall_clock as on_the_wall_clock
from recorded_runs import DRIVEN, load_runs, run_experiment
from session_cache import build_once

from experiments.run.domain import reserved
from node_runtime import transport

PROPERTY_SEED = 'PROPERTY_SEED'
# no time limit of a single example: a busy machine would exceed it
hypothesis.settings.register_profile('any machine', deadline=None)
hypothesis.settings.load_profile('any machine')
WAITING_S = 900  # for the drives of others, and for one of its own
# A shell that starts the tests in the background ignores SIGINT, nohup ignores SIGHUP; the programs
# that the tests start would inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def pytest_configure(config):
    # before the plug-in reads it: every commit sees examples of its own, every run of it the same
    if getattr(config.option, 'hypothesis_seed', None) is None:
        config.option.hypothesis_seed = str(commit_seed.seed(PROPERTY_SEED))
    # the settings of the shell must not decide which nodes a test sees
    for name in ('ROS_DOMAIN_ID', *transport.VARIABLES):
        os.environ.pop(name, None)
    os.environ[transport.RANGE] = transport.LOCALHOST
    # one cache for all workers and for the nodes that they start; kept for the next session
    os.environ.setdefault('MPCC_CACHE_DIR', str(config.rootpath / 'build/compiled'))


def pytest_report_header(config):
    return f'properties: {PROPERTY_SEED}={config.option.hypothesis_seed} repeats these examples'


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    # what is imported and collected lives to the end: to look through it for garbage, again and
    # again, takes as long as some of the tests
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(tryfirst=True)  # before -m selects
def pytest_collection_modifyitems(config, items):
    unread = [
        item
        for item in items
        if (reads := item.get_closest_marker('reads')) and not changes.any_changed(reads.args)
    ]
    if unread:
        config.hook.pytest_deselected(items=unread)
        items[:] = [item for item in items if item not in unread]
    for item in items:
        if 'dds' in getattr(item, 'fixturenames', ()):
            item.add_marker('ros')
        if 'wall_clock' in getattr(item, 'fixturenames', ()):
            item.add_marker(pytest.mark.timeout(WAITING_S))
            if not on_the_wall_clock.may_set_priority():
                item.add_marker('alone')
    # modules of many costly tests first: in parallel, none of them is the last that is waited for
    costly = Counter(item.path for item in items if is_costly(item))
    items.sort(key=lambda item: -costly[item.path])


def is_costly(item):
    return any(item.get_closest_marker(name) for name in ('ros', 'slow'))


def pytest_runtest_setup(item):
    for mark in item.iter_markers('needs'):
        for name in mark.args:
            capabilities.require(name)


@pytest.fixture(scope='session')
def dds():
    """Mark what depends on this as `ros`: it starts nodes that talk over Fast DDS.

    Nodes that `experiments run` starts get a free domain from it, other ones from `domain`.
    """


@pytest.fixture(scope='session')
def wall_clock(dds):
    """Return the module `wall_clock`, for nodes that drive on it with real-time priority.

    What depends on this is marked as `alone` where the user may not set that.
    """
    return on_the_wall_clock


@pytest.fixture(scope='module')
def domain(dds):
    """Return an unused ROS domain, also set as ROS_DOMAIN_ID.

    It is reserved for one test module, so that modules may run at the same time.
    """
    with reserved({}) as number, pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(number))
        yield number


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Return a folder with a package `some_pkg` that is installed: no package.xml beside it."""
    module = tmp_path / 'site-packages/some_pkg'
    module.mkdir(parents=True)
    (module / '__init__.py').touch()
    monkeypatch.syspath_prepend(str(module.parent))
    monkeypatch.setattr(sys, 'prefix', str(tmp_path / 'venv'))
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    return tmp_path


@pytest.fixture(scope='session')
def make_drive():
    """Return a function that makes a Drive, see `straight_drive.drive_of`."""
    return straight_drive.drive_of


@pytest.fixture(scope='session')
def recorded_runs(dds, tmp_path_factory):
    """Return the double lane change, driven over Fast DDS by every controller of the paper."""
    folder = build_once(
        tmp_path_factory, 'recorded_runs', lambda folder: run_experiment(folder, *DRIVEN)
    )
    return load_runs(folder, DRIVEN[0])
