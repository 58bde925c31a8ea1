"""Controllers are compiled beside the first run on a machine; nothing of it outlives that run."""

import pytest
import quick_compiler
from wait_until import lives, wait_until

from experiments.configuration import inputs
from experiments.run import compile_ahead
from mpcc_controller import car_file

pytestmark = pytest.mark.needs('compiler')
COMPILER = """#!/bin/sh
test "$1" = --version && exec echo a compiler
echo $$ > {folder}/$$.part && mv {folder}/$$.part {folder}/$$.begun
exec sleep 600
"""


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv('MPCC_CACHE_DIR', str(tmp_path / 'cache'))
    return tmp_path / 'cache'


@pytest.fixture
def controllers():
    params = inputs.controller_params('frenet')
    return [(params, car_file.load(params))]


def test_solvers_are_compiled_within_the_context_unless_the_cache_has_a_library(
    cache, controllers, tmp_path, monkeypatch
):
    monkeypatch.setenv('CC', quick_compiler.write(tmp_path))
    assert compile_ahead.is_worth_while()
    with compile_ahead.compiling(controllers):
        wait_until(lambda: any(cache.glob('frenet_riccati-*.so')), 240.0, 'nothing is compiled')
    assert not compile_ahead.is_worth_while()


def test_compilers_end_with_the_context_and_leave_no_files(
    cache, controllers, tmp_path, monkeypatch
):
    compiler = tmp_path / 'compiler'
    compiler.write_text(COMPILER.format(folder=tmp_path))
    compiler.chmod(0o755)
    monkeypatch.setenv('CC', str(compiler))
    with compile_ahead.compiling(controllers):
        wait_until(lambda: any(tmp_path.glob('*.begun')), 240.0, 'no compiler was started')
    (begun,) = tmp_path.glob('*.begun')
    # killed, but init may be slow to take it
    wait_until(lambda: not lives(int(begun.stem)), 60.0, 'the compiler goes on')
    assert not list(cache.glob('.build-*'))
