"""The seed is taken from the variable, else from the commit, else it is 0 with a warning."""

import subprocess
from pathlib import Path

import commit_seed
import pytest

NAME = 'SEED_OF_A_TEST'


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """Return a folder where the module is taken to lie, outside every repository."""
    monkeypatch.delenv(NAME, raising=False)
    for name in ('GIT_DIR', 'GIT_WORK_TREE'):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv('GIT_CEILING_DIRECTORIES', str(tmp_path.parent))
    monkeypatch.setattr(commit_seed, '__file__', str(tmp_path / Path(commit_seed.__file__).name))
    return tmp_path


def git(folder, *arguments):
    command = ['git', '-c', 'user.name=a', '-c', 'user.email=a@b.example', *arguments]
    return subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True).stdout


def test_the_variable_is_the_seed(repository, monkeypatch):
    monkeypatch.setenv(NAME, '17')
    assert commit_seed.seed(NAME) == 17
    monkeypatch.setenv(NAME, 'soon')
    with pytest.raises(ValueError, match='soon'):
        commit_seed.seed(NAME)


def test_every_commit_has_a_seed_of_its_own(repository):
    git(repository, 'init')
    seeds = []
    for message in ('one', 'two'):
        git(repository, 'commit', '--allow-empty', '--no-gpg-sign', '-m', message)
        seeds.append(commit_seed.seed(NAME))
        assert f'{seeds[-1]:08x}' == git(repository, 'rev-parse', 'HEAD')[:8]
    assert seeds[0] != seeds[1]


def test_outside_a_repository_it_is_zero_with_a_warning(repository):
    with pytest.warns(UserWarning, match=f'not a git repository.*{NAME}'):
        assert commit_seed.seed(NAME) == 0


def test_without_git_it_is_zero_with_a_warning(repository, monkeypatch):
    monkeypatch.setenv('PATH', str(repository))
    with pytest.warns(UserWarning, match=f'git.*{NAME}'):
        assert commit_seed.seed(NAME) == 0
