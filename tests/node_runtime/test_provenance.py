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


def test_a_clean_tree_is_its_commit(tree):
    assert provenance.commit() == git(tree, 'rev-parse', 'HEAD')


def test_untracked_files_and_results_do_not_make_the_tree_dirty(tree):
    (tree / 'paper' / 'claims.md').write_text('second\n')
    (tree / 'untracked.txt').write_text('new\n')
    assert provenance.commit() == git(tree, 'rev-parse', 'HEAD')


@pytest.mark.parametrize(
    'name', ['a.md', 'node_runtime/node_runtime/provenance.py', 'bags/package.xml']
)
def test_any_other_changed_file_makes_the_tree_dirty(tree, name):
    (tree / name).write_text('second\n')
    assert provenance.commit() == git(tree, 'rev-parse', 'HEAD') + '-dirty'


def test_inside_another_repository_there_is_no_commit(tree):
    (tree / 'bags' / 'package.xml').unlink()
    assert provenance.commit() == ''


def test_without_git_there_is_no_commit(tree, monkeypatch):
    monkeypatch.setenv('PATH', '')
    assert provenance.commit() == ''
