"""The programs in .ci: budget, installation, the run of the continuous integration, inventory."""

import importlib.util
import os
import pty
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest
from installation import ROOT

BUDGET = 'car  {}  lines  car/*.py car/*.c\nproduct  1  files  *.py :!tests  # no tests\n'
UV = Path(sys.prefix, 'bin/uv')
NEEDS_UV = pytest.mark.skipif(not UV.exists(), reason='needs uv')


@pytest.fixture
def measure(tmp_path):
    """Return measure(table) -> (exit code, stdout, stderr) in a clone with two lines of a car."""
    files = {
        'car/a/drive.py': '"""Drive."""\n',
        'car/drive.c': '/* drive */\n',
        'car/gone.c': '/* gone */\n',
        'tests/a.py': '\n' * 50,
        '.ci/budget.py': (ROOT / '.ci/budget.py').read_text(),
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    for words in (['init'], ['add', 'car', 'tests']):
        subprocess.run(['git', '-C', tmp_path, *words], check=True, capture_output=True)
    (tmp_path / 'car/gone.c').unlink()
    (tmp_path / 'car/untracked.py').write_text('\n' * 9)

    def run(table):
        (tmp_path / '.ci/budget.txt').write_text(table)
        command = [sys.executable, tmp_path / '.ci/budget.py']
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        return done.returncode, done.stdout, done.stderr

    return run


@pytest.mark.parametrize(
    ('table', 'code', 'error'),
    [
        (BUDGET.format(1000), 0, ''),
        (BUDGET.format(1), 1, 'car has 2 lines, allowed 1: make it smaller, or raise the number'),
        ('# comment\nlorry 5 lines lorry/*.py\n', 1, '.ci/budget.txt:2: lorry: git tracks no such'),
        ('car 5 inches car/*.py\n', 1, 'must be `WHAT NUMBER lines|files|MB PATHSPEC ...`'),
    ],
)
def test_the_budget_counts_tracked_files_and_names_what_is_above_it(measure, table, code, error):
    done, printed, errors = measure(table)
    assert (done, error in errors, bool(errors)) == (code, True, bool(error))
    if 'product' in table:
        rows = [line.split() for line in printed.splitlines()]
        assert [row[:2] for row in rows[1:]] == [['car', '2'], ['product', '1']]


MAKE = """#!/bin/sh
echo "make $* require=${REQUIRE:-no} chromium=${REQUIRE_CHROMIUM:-no} ipv6=${REQUIRE_IPV6:-no}"
exit 7
"""
TOOLS = ('bash', 'cp', 'dirname', 'env', 'mktemp', 'rm', 'sed', 'sh', 'tail', 'timeout')
BROKEN_APT = '#!/bin/sh\necho "E: no mirror answers" >&2; exit 100\n'
SOUND_APT = '#!/bin/sh\necho "Reading package lists"\ncp "$0" "${0%/*}/chromium"\n'
ROOT_USER, USER = '#!/bin/sh\necho 0\n', '#!/bin/sh\necho 1000\n'


@pytest.mark.parametrize(
    ('programs', 'chromium', 'reason'),
    [
        ({'chromium': MAKE}, 'no', ''),
        ({'apt-get': SOUND_APT}, 'no', ''),
        ({'apt-get': BROKEN_APT}, '0', '  | E: no mirror answers'),
        ({}, '0', '  | there is no apt-get'),
        ({'apt-get': SOUND_APT, 'id': USER}, '0', '  | only root can install it'),
    ],
)
def test_the_continuous_integration_installs_a_browser_or_warns(
    programs, chromium, reason, tmp_path
):
    for name in TOOLS:
        (tmp_path / name).symlink_to(shutil.which(name))
    for name, text in {'make': MAKE, 'id': ROOT_USER, **programs}.items():
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    given = {'PATH': str(tmp_path), 'TMPDIR': str(tmp_path), 'REQUIRE_IPV6': '0'}
    command = [tmp_path / 'bash', ROOT / '.ci/run']
    done = subprocess.run(command, env=given, capture_output=True, text=True, timeout=240)
    assert done.returncode == 7
    assert done.stdout == f'make check CHANGED_SINCE= require=all chromium={chromium} ipv6=0\n'
    assert (reason in done.stderr, bool(done.stderr)) == (True, bool(reason))


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Return a function that installs as `make setup` does; the text of a program stands for uv.

    The interpreter is that of an environment with pip and no uv.
    """
    venv.create(tmp_path / 'venv', symlinks=True)
    (packages,) = (tmp_path / 'venv').glob('lib/*/site-packages')
    (packages / 'pip').symlink_to(Path(importlib.util.find_spec('pip').origin).parent)
    for name in [name for name in os.environ if name.startswith(('PIP_', 'UV_', 'SSL_'))]:
        monkeypatch.delenv(name)
    monkeypatch.setenv('PATH', f'{tmp_path}:/usr/bin:/bin')

    def run(uv, **options):
        if uv:
            (tmp_path / 'uv').write_text(f'#!/bin/sh\n{uv}\n')
            (tmp_path / 'uv').chmod(0o755)
        command = [tmp_path / 'venv/bin/python', ROOT / '.ci/install.py', 'no-such-package']
        options = {'capture_output': True, 'text': True} | options
        return subprocess.run(command, timeout=240, **options)

    return run


@pytest.mark.parametrize(
    ('uv', 'code', 'shown'),
    [
        ('exec >&2; echo "Resolved 2"; echo " + a==1"; echo "Installed 2"', 0, 'Resolved 2\nInst'),
        ('exec >&2; echo "error: Failed: a"; echo "cause: No space left"; exit 2', 2, 'No space'),
    ],
)
def test_what_uv_prints_is_shown_but_for_the_list_of_packages(install, uv, code, shown):
    done = install(uv)
    assert (done.returncode, shown in done.stderr) == (code, True)
    assert 'a==1' not in done.stderr
    assert 'could not reach' not in done.stderr


def test_on_a_terminal_progress_is_a_line_that_changes(install):
    ours, its = pty.openpty()
    options = {'capture_output': False, 'stdout': its, 'stderr': its, 'text': False}
    done = install("printf '\\r\\033[2Ka  10 MiB' >&2; test -t 2", **options)
    os.close(its)
    with open(ours, 'rb', buffering=0) as terminal:
        text = terminal.read(4096)
    assert (done.returncode, text) == (0, b'\r\x1b[2Ka  10 MiB')


def test_packages_come_from_where_pip_takes_them(install, tmp_path, monkeypatch):
    (tmp_path / 'pip.conf').write_text(
        '[global]\nindex-url = https://one.example/simple\nfind-links = /a\n  /b\n'
        'extra-index-url = https://two.example\ncert = /a.pem\n'
    )
    monkeypatch.setenv('PIP_CONFIG_FILE', str(tmp_path / 'pip.conf'))
    monkeypatch.setenv('PIP_EXTRA_INDEX_URL', 'https://three.example')
    printed = install("env | grep -E '^(UV|SSL)_' | sort").stdout
    assert printed.split() == [
        'SSL_CERT_FILE=/a.pem',
        'UV_DEFAULT_INDEX=https://one.example/simple',
        'UV_FIND_LINKS=/a,/b',
        'UV_INDEX=https://three.example',
        'UV_INDEX_STRATEGY=unsafe-best-match',
    ]


@pytest.mark.parametrize('uv', ['', pytest.param(f'exec {UV} "$@"', marks=NEEDS_UV)])
def test_a_server_that_cannot_be_reached_is_named_in_one_line(install, monkeypatch, uv):
    """Without a uv, pip is to install it."""
    monkeypatch.setenv('PIP_INDEX_URL', 'https://me:secret@127.0.0.1:9/simple')
    monkeypatch.setenv('UV_HTTP_RETRIES', '0')
    done = install(uv)
    assert done.returncode != 0
    (line,) = done.stderr.splitlines()
    assert line.startswith('error: could not reach 127.0.0.1 (Connection refused')
    assert 'HTTPS_PROXY' in line
    assert 'secret' not in done.stderr + done.stdout


@pytest.mark.slow
def test_the_inventory_lists_every_kind_of_name_that_users_rely_on():
    command = [sys.executable, ROOT / '.ci/inventory.py']
    done = subprocess.run(command, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr  # 1 where a kind has no name
    assert {
        'command experiments run --mode lockstep',
        'parameter controller limits.brake_n',
        'topic /vehicle/odometry nav_msgs/msg/Odometry',
        'figure figures/trajectories.png',
        'python bags.Run frame',
    } <= {*done.stdout.splitlines()}
