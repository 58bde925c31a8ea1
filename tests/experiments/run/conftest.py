"""A ring of shell programs where the nodes are looked for, and folders that do not move."""

from pathlib import Path

import pytest
from shell_ring import NODES


@pytest.fixture
def prefix(tmp_path, monkeypatch):
    """Return replace(node, script) for a ring of shell programs that ends well."""

    def replace(node, script):
        program = tmp_path / 'prefix/lib' / node
        program.parent.mkdir(parents=True, exist_ok=True)
        program.write_text(f'#!/bin/sh\n{script}')
        program.chmod(0o755)

    for node, script in NODES.items():
        replace(node, script)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path / 'prefix'))
    return replace


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
