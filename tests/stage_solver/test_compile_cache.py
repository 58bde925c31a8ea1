"""C code is compiled once for all processes; what is damaged or missing is never loaded."""

import ctypes
import os
import subprocess
import sys

import pytest
from capabilities import ORDINARY_USER

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


@pytest.fixture
def no_compiler(monkeypatch):
    """Return a function after which no compiler is found."""
    return lambda: monkeypatch.setenv('CC', 'no-such-compiler')


def truncate(library):
    library.write_bytes(library.read_bytes()[:2000])


def flip(library):
    code = bytearray(library.read_bytes())
    code[0x1000:0x1100] = bytes(byte ^ 0xFF for byte in code[0x1000:0x1100])
    library.write_bytes(code)


def empty(library):
    library.write_bytes(b'')


def lose_the_checksum(library):
    library.with_suffix('.sha256').unlink()


DAMAGES = pytest.mark.parametrize('damage', [truncate, flip, empty, lose_the_checksum])


@needs_compiler
@DAMAGES
def test_a_damaged_library_is_compiled_again_with_one_line(damage, caplog):
    damage(compile_cache.compile_library(SOURCE, 'twice', FLAGS))
    for _ in range(2):
        library = compile_cache.compile_library(SOURCE, 'twice', FLAGS)
    assert twice(library, 21.0) == 42.0
    assert [record.getMessage() for record in caplog.records] == [
        f'{library} is damaged: it is compiled again'
    ]


@needs_compiler
@DAMAGES
def test_without_a_compiler_a_damaged_library_is_refused(damage, no_compiler):
    library = compile_cache.compile_library(SOURCE, 'twice', FLAGS)
    damage(library)
    no_compiler()
    with pytest.raises(compile_cache.CompileError, match=rf'{library} is damaged.*MPCC_CACHE_DIR'):
        compile_cache.compile_library(SOURCE, 'twice', FLAGS)


@needs_compiler
def test_without_a_compiler_what_any_compiler_has_built_is_loaded(no_compiler):
    library = compile_cache.compile_library(SOURCE, 'twice', FLAGS)
    no_compiler()
    assert compile_cache.compile_library(SOURCE, 'twice', FLAGS) == library
    with pytest.raises(compile_cache.CompileError, match='no library of it'):
        compile_cache.compile_library(SOURCE, 'twice', ('-O1',))


def test_without_compiler_and_library_the_error_names_both_ways_out(monkeypatch, cache):
    monkeypatch.setenv('PATH', '')
    with pytest.raises(compile_cache.CompileError) as caught:
        compile_cache.compile_library(SOURCE, 'twice', FLAGS)
    assert str(caught.value) == (
        f'no C compiler for twice, and no library of it is in {cache}: '
        'install one (Debian, Ubuntu: apt install gcc), or let MPCC_CACHE_DIR name a folder '
        'in which a machine of this kind has built the libraries'
    )


@needs_compiler
def test_a_folder_that_cannot_be_written_serves_what_it_has_and_refuses_the_rest(cache):
    """As a user who is not root, whom permissions do not bind."""
    library = compile_cache.compile_library(SOURCE, 'twice', FLAGS)
    code = (
        'from stage_solver import compile_cache;'
        f'print(compile_cache.compile_library({SOURCE!r}, "twice", {FLAGS!r}));'
        f'compile_cache.compile_library({SOURCE!r}, "thrice", {FLAGS!r})'
    )
    cache.chmod(0o555)
    command = [*ORDINARY_USER, sys.executable, '-c', code]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    cache.chmod(0o755)
    assert done.stdout == f'{library}\n'
    assert (
        f'CompileError: compiled code cannot be kept in {cache} ({cache}/thrice-'
        in done.stderr.splitlines()[-1]
    )
    assert 'Permission denied); let MPCC_CACHE_DIR name a folder' in done.stderr


def test_a_folder_that_cannot_be_made_is_refused_by_name(cache):
    cache.write_text('a file')
    with pytest.raises(compile_cache.CompileError, match=f'kept in {cache} .*MPCC_CACHE_DIR'):
        compile_cache.compile_library(SOURCE, 'twice', FLAGS)
