"""Capabilities of the machine that tests need; without them a test is skipped, or fails.

A test declares its needs by `@pytest.mark.needs('compiler')`, or calls `require('compiler')` in a
fixture. REQUIRE=all makes everything that is missing a failure; REQUIRE_COMPILER=1 does so for one
capability, and REQUIRE_COMPILER=0 exempts it from REQUIRE=all.
"""

import importlib.util
import os
import shutil
import socket
import subprocess
import sysconfig
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

SITE = Path(__file__).parents[2] / 'build/docs/html/index.html'
BROWSERS = ('chromium', 'chromium-browser', 'google-chrome')
# an ordinary user: without capabilities, and with no real-time priority or locked memory allowed
ORDINARY_USER = (
    *('setpriv', '--bounding-set=-all', '--inh-caps=-all'),
    *('prlimit', '--rtprio=0', '--memlock=0'),
)
PRIORITY = 'import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(90))'


def chromium() -> str | None:
    """Return the path of a Chromium, None where none is installed."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


def runs(*command: str) -> bool:
    """Return whether a command can be started and succeeds."""
    try:
        return subprocess.run(command, capture_output=True, timeout=60).returncode == 0
    except (OSError, subprocess.TimeoutExpired):
        return False


def has_tf2() -> bool:
    """Return whether tf2_msgs is installed, or can be built by tests/bags/viewers/tf2_build.py."""
    header = Path(sysconfig.get_path('include'), 'Python.h')
    installed = importlib.util.find_spec('tf2_msgs') is not None
    return installed or (shutil.which('g++') is not None and header.exists())


def has_ipv6() -> bool:
    """Return whether this machine has the IPv6 loopback address."""
    with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(('::1', 0))
        except OSError:
            return False
    return True


def has_compiler() -> bool:
    """Return whether a C compiler is found where the packages look for one."""
    from stage_solver import compile_cache

    return compile_cache.find_compiler() is not None


class Capability(NamedTuple):
    """A property of the machine: its probe, and the message where it is missing."""

    probe: Callable[[], bool]
    missing: str


CAPABILITIES = {
    'chromium': Capability(
        lambda: chromium() is not None, 'no Chromium is installed: the report is not looked at'
    ),
    'compiler': Capability(has_compiler, 'no C compiler is installed'),
    'ffmpeg': Capability(
        lambda: shutil.which('ffmpeg') is not None, 'no ffmpeg is installed: no video is written'
    ),
    'ipv6': Capability(has_ipv6, 'the IPv6 loopback address ::1 is not configured'),
    'namespaces': Capability(
        lambda: runs('unshare', '--net', '--mount', 'ip', 'link', 'show'),
        'this user may not make network namespaces, or there is no `ip`',
    ),
    'ordinary_user': Capability(
        lambda: runs(*ORDINARY_USER, 'true'), 'this user may not drop its privileges'
    ),
    'priority': Capability(
        lambda: runs('python3', '-c', PRIORITY), 'this user may not set real-time priorities'
    ),
    'site': Capability(SITE.is_file, 'the documentation site is not built: make docs'),
    'tf2': Capability(
        has_tf2, 'tf2_msgs is not installed; to build it takes g++ and the headers of Python'
    ),
}


@cache
def is_present(name: str) -> bool:
    """Return whether this machine has a capability; probed once per process."""
    return CAPABILITIES[name].probe()


def is_required(name: str) -> bool:
    """Return whether the environment demands a capability."""
    own = os.environ.get(f'REQUIRE_{name.upper()}')
    return own != '0' if own else os.environ.get('REQUIRE') == 'all'


def require(name: str, detail: str = '') -> None:
    """Skip the present test where a capability is missing; fail it where that is required.

    Raises KeyError for a capability that is not in CAPABILITIES.
    """
    if not is_present(name):
        report_missing(name, detail)


def report_missing(name: str, detail: str = '') -> None:
    """Skip or fail the present test: a capability turned out to be missing."""
    message = CAPABILITIES[name].missing + (f' ({detail})' if detail else '')
    if is_required(name):
        pytest.fail(f'{message}; it is required: REQUIRE_{name.upper()}=0 skips what needs it')
    pytest.skip(message)
