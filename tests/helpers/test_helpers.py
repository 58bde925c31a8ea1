"""What decides which tests run and what they share: a mistake in it would hide others."""

import os
import subprocess
from fnmatch import fnmatch

import capabilities
import changes
import pytest
from node_graph import OF_PROCESSES

GIT = ('git', '-c', 'user.name=a', '-c', 'user.email=a@b.example', '-c', 'commit.gpgsign=false')


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
    monkeypatch, tmp_path, environment, ends
):
    for name in [name for name in os.environ if name.startswith('REQUIRE')]:
        monkeypatch.delenv(name)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv('PATH', str(tmp_path))  # no browser is in it
    capabilities.is_present.cache_clear()
    with pytest.raises(ends, match='no Chromium is installed'):
        capabilities.require('chromium')
    capabilities.is_present.cache_clear()


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """Return git(*words) in a repository with a commit, where the helpers are taken to lie."""

    def git(*words):
        return subprocess.check_output([*GIT, *words], cwd=tmp_path, text=True).strip()

    for name in ('GIT_DIR', 'GIT_WORK_TREE', changes.VARIABLE):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(changes, 'ROOT', tmp_path)
    git('init')
    for name in ('a.md', 'b.md', 'c.md'):
        (tmp_path / name).write_text('text')
    git('add', '.')
    git('commit', '-m', 'one')
    return git


def test_what_a_test_reads_has_changed_since_a_commit_or_may_have(
    repository, monkeypatch, tmp_path
):
    first = repository('rev-parse', 'HEAD')
    (tmp_path / 'a.md').write_text('other text')
    repository('commit', '-am', 'two')
    (tmp_path / 'b.md').unlink()
    (tmp_path / 'd.md').touch()
    for since, names in (
        (first, 'abd'),
        ('HEAD', 'bd'),
        ('no-such-commit', 'abcdx'),
        ('', 'abcdx'),
    ):
        monkeypatch.setenv(changes.VARIABLE, since)
        assert [name for name in 'abcdx' if changes.any_changed([f'{name}.*'])] == [*names]


def test_every_pattern_of_what_the_tests_of_processes_read_names_a_file():
    files = subprocess.check_output(['git', 'ls-files'], cwd=changes.ROOT, text=True).splitlines()
    for pattern in OF_PROCESSES.args:
        assert any(fnmatch(file, pattern) for file in files), pattern
