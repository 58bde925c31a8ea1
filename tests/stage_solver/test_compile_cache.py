"""C code is compiled once for all processes; without a compiler one warning names the loss."""

import ctypes
import os
import subprocess
import sys
import warnings

import pytest

from stage_solver import compile_cache

SOURCE = 'double twice(double x) { return 2.0 * x; }'
FLAGS = ('-O2',)
needs_compiler = pytest.mark.needs('compiler')


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv('MPCC_CACHE_DIR', str(tmp_path / 'cache'))
    return tmp_path / 'cache'


def twice(library, x):
    function = ctypes.CDLL(str(library)).twice
    function.argtypes, function.restype = [ctypes.c_double], ctypes.c_double
    return function(x)


@needs_compiler
def test_a_source_becomes_a_library_that_runs(cache):
    library = compile_cache.compile_library(SOURCE, 'twice', FLAGS)
    assert library.parent == cache
    assert library.name.startswith('twice-')
    assert twice(library, 21.0) == 42.0


@needs_compiler
def test_the_second_time_nothing_is_compiled():
    first = compile_cache.compile_library(SOURCE, 'twice', FLAGS)
    before = first.stat()
    assert compile_cache.compile_library(SOURCE, 'twice', FLAGS) == first
    assert first.stat().st_mtime_ns == before.st_mtime_ns
    assert first.stat().st_ino == before.st_ino


@needs_compiler
def test_source_flags_and_name_decide_the_library():
    made = {
        compile_cache.compile_library(SOURCE, 'twice', FLAGS),
        compile_cache.compile_library(SOURCE + ' ', 'twice', FLAGS),
        compile_cache.compile_library(SOURCE, 'twice', ('-O1',)),
        compile_cache.compile_library(SOURCE, 'double', FLAGS),
        compile_cache.compile_library(SOURCE, 'twice', (*FLAGS, '-march=native')),
    }
    assert len(made) == 5


@needs_compiler
def test_the_processor_counts_only_when_the_code_is_made_for_it(monkeypatch):
    native = (*FLAGS, '-march=native')
    generic, tuned = (compile_cache.compile_library(SOURCE, 'twice', f) for f in (FLAGS, native))
    monkeypatch.setattr(compile_cache, '_cpu', lambda: 'another processor')
    assert compile_cache.compile_library(SOURCE, 'twice', FLAGS) == generic
    assert compile_cache.compile_library(SOURCE, 'twice', native) != tuned


@needs_compiler
def test_processes_that_start_together_get_one_library(cache):
    code = (
        'import sys; from stage_solver import compile_cache;'
        f'print(compile_cache.compile_library({SOURCE!r}, "twice", {FLAGS!r}))'
    )
    started = [
        subprocess.Popen([sys.executable, '-c', code], stdout=subprocess.PIPE, text=True)
        for _ in range(4)
    ]
    printed = {process.communicate(timeout=240)[0].strip() for process in started}
    assert len(printed) == 1
    assert twice(printed.pop(), 1.5) == 3.0
    assert len(list(cache.glob('*.so'))) == 1
    assert not list(cache.glob('.build-*'))


@needs_compiler
def test_an_invalid_source_raises_with_the_output_of_the_compiler(cache):
    with pytest.raises(compile_cache.CompileError, match=r'(?s)refuses broken.*error:'):
        compile_cache.compile_library('int main( {', 'broken', ())
    assert not list(cache.glob('*.so'))


def test_without_a_compiler_there_is_no_library(monkeypatch):
    monkeypatch.setenv('CC', 'no-such-compiler')
    assert compile_cache.find_compiler() is None
    assert compile_cache.compile_library(SOURCE, 'twice', FLAGS) is None
    monkeypatch.delenv('CC')
    monkeypatch.setenv('PATH', '')
    assert compile_cache.compile_library(SOURCE, 'twice', FLAGS) is None


def test_the_missing_compiler_is_warned_of_once():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        for _ in range(3):
            compile_cache.warn_no_compiler('the test runs ten times slower')
    assert [warning.category for warning in caught] == [compile_cache.NoCompilerWarning]
    assert 'no C compiler found: the test runs ten times slower' in str(caught[0].message)


def test_the_environment_sets_the_folder_of_the_cache(monkeypatch, tmp_path):
    monkeypatch.delenv('MPCC_CACHE_DIR')
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'xdg'))
    assert compile_cache.cache_dir() == tmp_path / 'xdg/mpcc'
    monkeypatch.delenv('XDG_CACHE_HOME')
    monkeypatch.setenv('HOME', str(tmp_path))
    assert compile_cache.cache_dir() == tmp_path / '.cache/mpcc'


@needs_compiler
def test_the_cache_may_be_on_a_path_with_spaces(monkeypatch, tmp_path):
    monkeypatch.setenv('MPCC_CACHE_DIR', str(tmp_path / 'a cache'))
    assert os.path.exists(compile_cache.compile_library(SOURCE, 'twice', FLAGS))
