"""The script of the continuous integration installs a browser or warns that it is missing."""

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TOOLS = ('bash', 'cp', 'dirname', 'env', 'mktemp', 'rm', 'sed', 'sh', 'tail', 'timeout')
MAKE = """#!/bin/sh
echo "make $* require=${REQUIRE:-no} chromium=${REQUIRE_CHROMIUM:-no} mounts=${REQUIRE_MOUNTS:-no}"
exit 7
"""
REQUIRED = 'make check require=all chromium=no mounts=no\n'
WITHOUT_BROWSER = 'make check require=all chromium=0 mounts=no\n'
ROOT_USER = '#!/bin/sh\necho 0\n'
BROKEN_APT = '#!/bin/sh\necho "E: no mirror answers" >&2; exit 100\n'
SOUND_APT = '#!/bin/sh\necho "Reading package lists"\ncp "$0" "${0%/*}/chromium"\n'


@pytest.fixture
def machine(tmp_path):
    """Return run(environment, **programs) -> (exit code, text): the script among few programs."""

    def run(environment=(), **programs):
        for name in TOOLS:
            (tmp_path / name).symlink_to(shutil.which(name))
        for name, text in {'make': MAKE, 'id': ROOT_USER, **programs}.items():
            program = tmp_path / name.replace('_', '-')
            program.write_text(text)
            program.chmod(0o755)
        given = {'PATH': str(tmp_path), 'TMPDIR': str(tmp_path), **dict(environment)}
        command = [tmp_path / 'bash', ROOT / '.ci' / 'run']
        result = subprocess.run(command, env=given, capture_output=True, text=True, timeout=240)
        return result.returncode, result.stdout + result.stderr

    return run


def test_a_browser_that_is_there_is_required(machine):
    assert machine(chromium=MAKE) == (7, REQUIRED)


def test_a_browser_that_was_installed_is_required(machine):
    assert machine(apt_get=SOUND_APT) == (7, REQUIRED)


def test_an_installation_that_fails_is_shown_and_the_checks_go_on(machine):
    code, output = machine(apt_get=BROKEN_APT)
    assert (code, WITHOUT_BROWSER in output) == (7, True)
    assert 'Chromium could not be installed (exit code 100)' in output
    assert '  | E: no mirror answers' in output


def test_a_machine_that_cannot_install_says_why_and_goes_on(machine):
    code, output = machine()
    assert (code, WITHOUT_BROWSER in output) == (7, True)
    assert '  | there is no apt-get' in output


def test_a_user_who_may_not_install_is_told_and_the_checks_go_on(machine):
    code, output = machine(apt_get=SOUND_APT, id='#!/bin/sh\necho 1000\n')
    assert (code, WITHOUT_BROWSER in output) == (7, True)
    assert '  | only root can install it' in output


def test_a_machine_that_cannot_have_something_may_be_exempted(machine):
    _, output = machine(chromium=MAKE, environment={'REQUIRE_MOUNTS': '0'})
    assert output == 'make check require=all chromium=no mounts=0\n'
