"""A missing capability skips its tests, and fails them where it is required."""

import os
import subprocess
import sys
from pathlib import Path

import capabilities
import pytest

TESTS = Path(__file__).parents[1]


@pytest.fixture
def without_browser(monkeypatch, tmp_path):
    """Hide every browser, and everything that the environment requires."""
    for name in [name for name in os.environ if name.startswith('REQUIRE')]:
        monkeypatch.delenv(name)
    monkeypatch.setenv('PATH', str(tmp_path))
    capabilities.is_present.cache_clear()
    yield
    capabilities.is_present.cache_clear()


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
def test_a_missing_capability_fails_a_test_only_where_it_is_required(
    without_browser, monkeypatch, environment, ends
):
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(ends, match='no Chromium is installed'):
        capabilities.require('chromium')


def test_the_mark_fails_a_test_before_it_begins(without_browser, tmp_path):
    (tmp_path / 'conftest.py').write_text((TESTS / 'conftest.py').read_text())
    (tmp_path / 'test_page.py').write_text(
        "import pytest\n\n@pytest.mark.needs('chromium')\ndef test_page():\n    print('began')\n"
    )
    result = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', tmp_path],
        env={**os.environ, 'PYTHONPATH': str(TESTS / 'helpers'), 'REQUIRE': 'all'},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=200,
    )
    assert result.returncode == 1, result.stdout
    assert 'no Chromium is installed' in result.stdout
    assert 'began' not in result.stdout


@pytest.mark.parametrize('name', capabilities.CAPABILITIES)
def test_every_capability_is_probed_without_an_error(name):
    assert capabilities.is_present(name) in (True, False)


def test_an_unknown_capability_is_an_error():
    with pytest.raises(KeyError):
        capabilities.require('teleportation')
