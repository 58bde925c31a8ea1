"""Shell programs in place of the nodes, processes that end with a test, folders that stay."""

import subprocess
from pathlib import Path

import pytest
from shell_nodes import NODES


@pytest.fixture
def prefix(tmp_path, monkeypatch):
    """Return replace(node, script) for shell programs that complete a run."""

    def replace(node, script):
        program = tmp_path / 'prefix/lib' / node
        program.parent.mkdir(parents=True, exist_ok=True)
        program.write_text(f'#!/bin/sh\nfor last; do :; done\n{script}')
        program.chmod(0o755)

    for node, script in NODES.items():
        replace(node, script)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path / 'prefix'))
    return replace


@pytest.fixture
def popen():
    """Return popen(word, ..., **options): a process of a session of its own, killed at the end."""
    started = []

    def start(*words, **options):
        started.append(subprocess.Popen(words, start_new_session=True, text=True, **options))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture
def refuse_moves(monkeypatch):
    """Return refuse(which): folders of which that is true move no more, as another user's do."""

    def refuse(which):
        rename = Path.rename

        def owned(path, target):
            if which(path):
                raise PermissionError(13, 'Permission denied', str(path))
            return rename(path, target)

        monkeypatch.setattr(Path, 'rename', owned)

    return refuse
