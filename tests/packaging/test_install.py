"""What `make setup` installs by uv, where from, and what it shows."""

import os
import pty
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
INSTALLS = """#!/bin/sh
echo "Resolved 2 packages in 1ms" >&2
echo " + package1==1" >&2
echo "Installed 2 packages in 1ms" >&2
"""
# the last line stays, as that of progress does while it changes
PROGRESS = """#!/bin/sh
printf '\\r\\033[2Kpackage1  10 MiB' >&2
test -t 2
"""
ENVIRONMENT = """#!/bin/sh
env | grep -E '^(UV|SSL)_'
"""
HAS_NO_SPACE = """#!/bin/sh
echo "error: Failed to install: package1" >&2
echo "  cause: No space left on device" >&2
exit 2
"""


@pytest.fixture
def make(tmp_path, monkeypatch):
    """Return a function that installs the requirements; the text of a program stands for uv."""
    (tmp_path / '.ci').mkdir()
    for name in ('Makefile', 'requirements.txt', '.ci/install.py'):
        shutil.copy(ROOT / name, tmp_path / name)
    (tmp_path / 'bin').mkdir()
    monkeypatch.setenv('PATH', f'{tmp_path / "bin"}:/usr/bin:/bin')
    command = ['make', '-C', tmp_path, '--no-print-directory', f'PYTHON={sys.executable}']

    def run(uv, **options):
        if uv:
            (tmp_path / 'bin/uv').write_text(uv)
            (tmp_path / 'bin/uv').chmod(0o755)
        options = {'capture_output': True, 'text': True} | options
        return subprocess.run([*command, '.venv/.requirements'], timeout=240, **options)

    return run


def test_in_a_log_the_list_of_packages_is_left_out(make):
    done = make(INSTALLS)
    assert done.returncode == 0, done.stderr
    assert done.stderr.splitlines() == ['Resolved 2 packages in 1ms', 'Installed 2 packages in 1ms']


def test_on_a_terminal_progress_is_a_line_that_changes(make):
    ours, its = pty.openpty()
    done = make(PROGRESS, capture_output=False, stdout=its, stderr=its, text=False)
    os.close(its)
    text = b''
    try:
        while part := os.read(ours, 4096):
            text += part
    except OSError:  # Linux says so at the end of a terminal
        pass
    finally:
        os.close(ours)
    assert done.returncode == 0, text
    assert b'\r\x1b[2Kpackage1  10 MiB' in text


def test_packages_come_from_where_pip_takes_them(make, tmp_path, monkeypatch):
    for name in [name for name in os.environ if name.startswith(('PIP_', 'UV_', 'SSL_'))]:
        monkeypatch.delenv(name)
    (tmp_path / 'pip.conf').write_text(
        '[global]\nindex-url = https://one.example/simple\nfind-links = /a\n  /b\n'
        'extra-index-url = https://two.example\ncert = /a.pem\n'
    )
    monkeypatch.setenv('PIP_CONFIG_FILE', str(tmp_path / 'pip.conf'))
    monkeypatch.setenv('PIP_EXTRA_INDEX_URL', 'https://three.example')
    done = make(ENVIRONMENT)
    assert done.returncode == 0, done.stderr
    given = dict(line.split('=', 1) for line in done.stdout.splitlines() if '=' in line)
    assert given == {
        'UV_DEFAULT_INDEX': 'https://one.example/simple',
        'UV_FIND_LINKS': '/a,/b',
        'UV_INDEX': 'https://three.example',
        'UV_INDEX_STRATEGY': 'unsafe-best-match',
        'SSL_CERT_FILE': '/a.pem',
    }


def test_a_server_that_cannot_be_reached_is_named_in_one_line(make, monkeypatch):
    monkeypatch.setenv('PIP_INDEX_URL', 'https://me:secret@127.0.0.1:9/simple')
    done = make('')  # there is no uv: pip is to install it
    assert done.returncode != 0
    lines = [line for line in done.stderr.splitlines() if not re.match(r'make(\[\d+\])?: ', line)]
    assert len(lines) == 1
    assert lines[0].startswith('error: could not reach 127.0.0.1 (Connection refused)')
    assert 'HTTPS_PROXY' in lines[0]
    assert 'secret' not in done.stderr + done.stdout


@pytest.mark.skipif(not shutil.which('uv', path=Path(sys.prefix, 'bin')), reason='needs uv')
def test_a_server_that_uv_cannot_reach_is_named_in_one_line(make, monkeypatch):
    monkeypatch.setenv('PIP_INDEX_URL', 'https://me:secret@127.0.0.1:9/simple')
    monkeypatch.setenv('UV_HTTP_RETRIES', '0')
    uv = shlex.quote(shutil.which('uv', path=Path(sys.prefix, 'bin')))
    done = make(f'#!/bin/sh\nexec {uv} "$@"\n')
    assert done.returncode != 0
    lines = [line for line in done.stderr.splitlines() if not re.match(r'make(\[\d+\])?: ', line)]
    assert len(lines) == 1
    assert lines[0].startswith('error: could not reach 127.0.0.1 (Connection refused')
    assert 'secret' not in done.stderr + done.stdout


def test_any_other_error_is_shown(make):
    done = make(HAS_NO_SPACE)
    assert done.returncode != 0
    assert 'No space left on device' in done.stderr
    assert 'could not reach' not in done.stderr
