"""An empty compile cache."""

import pytest


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    """Return an empty compile cache, for tests of what is compiled and when."""
    monkeypatch.setenv('MPCC_CACHE_DIR', str(tmp_path / 'cache'))
    return tmp_path / 'cache'
