"""The commit in the metadata of a run."""

import subprocess

import pytest

from node_runtime import provenance


def git(folder, *arguments):
    who = ('-c', 'user.name=A', '-c', 'user.email=a@b.c', '-c', 'commit.gpgsign=false')
    done = subprocess.run(
        ['git', '-C', folder, *who, *arguments], capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """Return a repository that holds this code, a result and a page."""
    for name in (
        'bags/package.xml',
        'node_runtime/node_runtime/provenance.py',
        'paper/claims.md',
        'a.md',
    ):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text('first\n')
    git(tmp_path, 'init', '-q')
    git(tmp_path, 'add', '.')
    git(tmp_path, 'commit', '-qm', 'First')
    monkeypatch.setattr(
        provenance, '__file__', str(tmp_path / 'node_runtime/node_runtime/provenance.py')
    )
    return tmp_path


CODE = ('a.md', 'node_runtime/node_runtime/provenance.py', 'bags/package.xml')


def test_a_tree_is_its_commit_and_dirty_once_a_file_that_is_no_result_has_changed(tree):
    head = git(tree, 'rev-parse', 'HEAD')
    assert provenance.commit() == head
    (tree / 'paper' / 'claims.md').write_text('second\n')
    (tree / 'untracked.txt').write_text('new\n')
    assert provenance.commit() == head
    for name in CODE:
        (tree / name).write_text('second\n')
        assert provenance.commit() == f'{head}-dirty'
        (tree / name).write_text('first\n')


def test_inside_another_repository_or_without_git_there_is_no_commit(tree, monkeypatch):
    (tree / 'bags' / 'package.xml').rename(tree / 'package.xml')
    assert provenance.commit() == ''
    (tree / 'package.xml').rename(tree / 'bags' / 'package.xml')
    monkeypatch.setenv('PATH', '')
    assert provenance.commit() == ''
