import os
import shutil
from pathlib import Path

import pytest

from node_runtime import source_tree

ROOT = Path(__file__).parents[2]


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """A source tree with one package, and a copy of it that is installed."""
    source = tmp_path / 'work'
    for file in ('node_runtime/node_runtime/clocks.py', 'node_runtime/package.xml', 'Makefile'):
        (source / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / file, source / file)
    monkeypatch.setattr(source_tree, 'PACKAGES', ('node_runtime',))
    monkeypatch.setattr(source_tree, '_origin', lambda package: None)
    installed = tmp_path / 'site/node_runtime'
    shutil.copytree(source / 'node_runtime/node_runtime', installed)
    (installed / '__init__.py').touch()
    spec = type('Spec', (), {'origin': str(installed / '__init__.py')})
    monkeypatch.setattr(source_tree.util, 'find_spec', lambda package: spec)
    return source


def edit(tree, name='clocks.py', text='# changed\n'):
    file = tree / 'node_runtime/node_runtime' / name
    file.write_text(text)
    later = file.stat().st_mtime + 10.0
    os.utime(file, (later, later))
    return file


def test_an_installed_copy_of_the_source_is_silent(tree):
    assert source_tree.describe_stale(tree) == ''


def test_an_edit_that_is_not_installed_is_named_with_what_to_do(tree):
    edit(tree)
    text = source_tree.describe_stale(tree / 'node_runtime')
    assert f'edits in {tree} have no effect: node_runtime/node_runtime/clocks.py' in text
    assert '`make setup`' in text


def test_a_new_file_counts_and_many_are_counted(tree):
    for name in ('a.py', 'b.py', 'c.py'):
        edit(tree, name)
    assert ' and 1 more; what runs is installed in ' in source_tree.describe_stale(tree)


def test_a_file_that_was_touched_but_not_changed_is_silent(tree):
    file = tree / 'node_runtime/node_runtime/clocks.py'
    edit(tree, text=file.read_text())
    assert source_tree.describe_stale(tree) == ''


def test_a_folder_outside_of_every_tree_is_silent(tree, tmp_path):
    edit(tree)
    assert source_tree.describe_stale(tmp_path / 'site') == ''


def test_the_tree_that_was_installed_from_is_watched_from_anywhere(tree, tmp_path, monkeypatch):
    edit(tree)
    monkeypatch.setattr(source_tree, '_origin', lambda package: tree)
    assert str(tree) in source_tree.describe_stale(tmp_path / 'site')


def test_source_that_runs_itself_is_silent(tree, monkeypatch):
    edit(tree)
    own = type('Spec', (), {'origin': str(tree / 'node_runtime/node_runtime/__init__.py')})
    monkeypatch.setattr(source_tree.util, 'find_spec', lambda package: own)
    assert source_tree.describe_stale(tree) == ''
