"""Controllers are compiled beside the first run on a machine; nothing of it outlives that run."""

import os
import time

import pytest

from experiments.configuration import inputs
from experiments.run import compile_ahead
from mpcc_controller import car_file

pytestmark = pytest.mark.needs('compiler')


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv('MPCC_CACHE_DIR', str(tmp_path / 'cache'))
    return tmp_path / 'cache'


@pytest.fixture
def controllers():
    params = inputs.controller_params('frenet')
    return [(params, car_file.load(params))]


def wait_until(is_so):
    end = time.monotonic() + 240
    while not is_so():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_a_cache_with_a_library_is_left_to_the_nodes(cache):
    assert compile_ahead.is_worth_while()
    cache.mkdir()
    (cache / 'any.so').touch()
    assert not compile_ahead.is_worth_while()


def test_solvers_are_compiled_within_the_context(cache, controllers):
    with compile_ahead.compiling(controllers):
        wait_until(lambda: any(cache.glob('frenet_riccati-*.so')))


def test_compilers_end_with_the_context_and_leave_no_files(
    cache, controllers, tmp_path, monkeypatch
):
    compiler = tmp_path / 'compiler'
    compiler.write_text(
        f"""#!/bin/sh
        test "$1" = --version && exec echo a compiler
        echo $$ > {tmp_path}/$$.part && mv {tmp_path}/$$.part {tmp_path}/$$.begun
        exec sleep 600
        """
    )
    compiler.chmod(0o755)
    monkeypatch.setenv('CC', str(compiler))
    with compile_ahead.compiling(controllers):
        wait_until(lambda: any(tmp_path.glob('*.begun')))
    (begun,) = tmp_path.glob('*.begun')
    with pytest.raises(ProcessLookupError):
        os.kill(int(begun.stem), 0)
    assert not list(cache.glob('.build-*'))
