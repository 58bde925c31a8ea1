"""A capability that is missing skips its tests, and fails them where it is required."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import require

TESTS = Path(__file__).parents[1]


@pytest.fixture
def without_browser(monkeypatch, tmp_path):
    """Hide every browser, and everything that the environment requires."""
    for name in [name for name in os.environ if name.startswith('REQUIRE')]:
        monkeypatch.delenv(name)
    monkeypatch.setenv('PATH', str(tmp_path))
    require.present.cache_clear()
    yield
    require.present.cache_clear()


@pytest.mark.parametrize(
    ('environment', 'ends'),
    [
        ({}, pytest.skip.Exception),
        ({'REQUIRE_COMPILER': '1'}, pytest.skip.Exception),
        ({'REQUIRE': 'all', 'REQUIRE_CHROMIUM': '0'}, pytest.skip.Exception),
        ({'REQUIRE': 'all'}, pytest.fail.Exception),
        ({'REQUIRE_CHROMIUM': '1'}, pytest.fail.Exception),
    ],
    ids=str,
)
def test_what_is_missing_fails_a_test_only_where_it_is_required(
    without_browser, monkeypatch, environment, ends
):
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(ends, match='no Chromium is installed'):
        require.need('chromium')


def test_the_mark_fails_a_test_before_it_begins(without_browser, tmp_path):
    (tmp_path / 'conftest.py').write_text((TESTS / 'conftest.py').read_text())
    (tmp_path / 'test_page.py').write_text(
        "import pytest\n\n@pytest.mark.needs('chromium')\ndef test_page():\n    print('began')\n"
    )
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', tmp_path],
        env={**os.environ, 'PYTHONPATH': str(TESTS / 'helpers'), 'REQUIRE': 'all'},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=200,
    )
    assert done.returncode == 1, done.stdout
    assert 'no Chromium is installed' in done.stdout
    assert 'began' not in done.stdout


@pytest.mark.parametrize('name', require.CAPABILITIES)
def test_every_capability_is_probed_without_an_error(name):
    assert require.present(name) in (True, False)


def test_a_capability_that_is_not_known_is_an_error():
    with pytest.raises(KeyError):
        require.need('teleportation')
