"""The script of the continuous integration: the browser is there, or everybody is told."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TOOLS = ('bash', 'cp', 'dirname', 'env', 'mktemp', 'rm', 'sed', 'sh', 'tail', 'timeout')
MAKE = '#!/bin/sh\necho "make $* required=${REQUIRE_CHROMIUM:-no}"; exit 7\n'
ROOT_USER = '#!/bin/sh\necho 0\n'
BROKEN_APT = '#!/bin/sh\necho "E: no mirror answers" >&2; exit 100\n'
SOUND_APT = '#!/bin/sh\necho "Reading package lists"\ncp "$0" "${0%/*}/chromium"\n'
OF_BROWSER = ROOT / 'tests' / 'bags' / 'report' / 'conftest.py'


@pytest.fixture
def machine(tmp_path):
    """Return run(**programs) -> (exit code, text): the script where only few programs are."""

    def run(**programs):
        for name in TOOLS:
            (tmp_path / name).symlink_to(shutil.which(name))
        for name, text in {'make': MAKE, 'id': ROOT_USER, **programs}.items():
            program = tmp_path / name.replace('_', '-')
            program.write_text(text)
            program.chmod(0o755)
        environment = {'PATH': str(tmp_path), 'TMPDIR': str(tmp_path)}
        command = [tmp_path / 'bash', ROOT / '.ci' / 'run']
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
        return done.returncode, done.stdout + done.stderr

    return run


def test_a_browser_that_is_there_is_required(machine):
    assert machine(chromium=MAKE) == (7, 'make check required=1\n')


def test_a_browser_that_was_installed_is_required(machine):
    assert machine(apt_get=SOUND_APT) == (7, 'make check required=1\n')


def test_an_installation_that_fails_is_shown_and_the_checks_go_on(machine):
    code, said = machine(apt_get=BROKEN_APT)
    assert (code, 'make check required=no' in said) == (7, True)
    assert 'Chromium could not be installed (exit code 100)' in said
    assert '  | E: no mirror answers' in said


def test_a_machine_that_cannot_install_says_why_and_goes_on(machine):
    code, said = machine()
    assert (code, 'make check required=no' in said) == (7, True)
    assert '  | there is no apt-get' in said


def test_a_user_who_may_not_install_is_told_and_the_checks_go_on(machine):
    code, said = machine(apt_get=SOUND_APT, id='#!/bin/sh\necho 1000\n')
    assert (code, 'make check required=no' in said) == (7, True)
    assert '  | only root can install it' in said


@pytest.mark.parametrize(('required', 'code', 'told'), [('', 0, 'skipped'), ('1', 1, 'error')])
def test_tests_in_a_browser_fail_without_one_where_it_is_required(tmp_path, required, code, told):
    shutil.copy(OF_BROWSER, tmp_path)
    (tmp_path / 'test_page.py').write_text('def test_page(browse):\n    pass\n')
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-ra', tmp_path],
        env={**os.environ, 'PATH': str(tmp_path), 'REQUIRE_CHROMIUM': required},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=200,
    )
    assert done.returncode == code, done.stdout
    assert 'no Chromium is installed' in done.stdout
    assert told in done.stdout.splitlines()[-1]
