"""The modules and tests that bench/mutation.py mutates and runs."""

import mutation
import pytest


@pytest.mark.parametrize('target', mutation.TARGETS, ids=lambda target: target.name)
def test_the_files_of_every_target_exist(target):
    for name in (target.module, *target.tests):
        assert (mutation.ROOT / name).is_file()
