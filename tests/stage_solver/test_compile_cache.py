"""C code is compiled once for all processes; what is damaged or missing is never loaded."""

import ctypes
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from capabilities import ORDINARY_USER
from small_problems import slalom

from stage_solver import compile_cache
from stage_solver.compile_cache import CompileError
from stage_solver.compiled_functions import BufferedFunction, compile_functions

SOURCE = 'double twice(double x) { return 2.0 * x; }'
PROGRAM = f"""
from stage_solver import compile_cache
print(compile_cache.compile_library({SOURCE!r}, 'twice', ('-O2',)), flush=True)
"""


@pytest.fixture(autouse=True)
def cache(own_cache):
    return own_cache


def compile_twice(source=SOURCE, name='twice', flags=('-O2',)):
    return compile_cache.compile_library(source, name, flags)


def twice(library, x):
    function = ctypes.CDLL(str(library)).twice
    function.argtypes, function.restype = [ctypes.c_double], ctypes.c_double
    return function(x)


def test_processes_that_start_together_compile_a_source_once(cache):
    started = [
        subprocess.Popen([sys.executable, '-c', PROGRAM], stdout=subprocess.PIPE, text=True)
        for _ in range(4)
    ]
    (printed,) = {process.communicate(timeout=240)[0].strip() for process in started}
    library = Path(printed)
    assert re.fullmatch(r'twice-\w{32}-\w{8}\.so', library.name)
    assert twice(library, 1.5) == 3.0
    made = library.stat()
    assert compile_twice() == library
    assert (library.stat().st_mtime_ns, library.stat().st_ino) == (made.st_mtime_ns, made.st_ino)
    suffixes = sorted(path.suffix for path in cache.iterdir())
    assert suffixes == ['.lock', '.sha256', '.so']


def test_source_flags_name_and_the_processor_of_native_code_decide_the_library(monkeypatch):
    native = {'flags': ('-O2', '-march=native')}
    others = ({'source': SOURCE + ' '}, {'flags': ('-O1',)}, {'name': 'double'}, native)
    made = [compile_twice(), *(compile_twice(**other) for other in others)]
    assert len(set(made)) == 5
    monkeypatch.setattr(compile_cache, '_cpu', lambda: 'another processor')
    assert compile_twice() == made[0]
    assert compile_twice(**native) not in made


def test_an_invalid_source_raises_with_the_output_of_the_compiler(cache):
    with pytest.raises(CompileError, match=r'(?s)refuses broken.*error:'):
        compile_twice('int main( {', 'broken')
    assert not list(cache.glob('*.so'))


@pytest.mark.parametrize(
    ('variables', 'folder'),
    [
        ({'MPCC_CACHE_DIR': '/own', 'XDG_CACHE_HOME': '/xdg', 'HOME': '/home/me'}, '/own'),
        ({'XDG_CACHE_HOME': '/xdg', 'HOME': '/home/me'}, '/xdg/mpcc'),
        ({'HOME': '/home/me'}, '/home/me/.cache/mpcc'),
    ],
)
def test_the_environment_sets_the_folder_of_the_cache(monkeypatch, variables, folder):
    for name in ('MPCC_CACHE_DIR', 'XDG_CACHE_HOME'):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert compile_cache.cache_dir() == Path(folder)


def test_folder_and_compiler_may_need_quotes_of_a_shell(monkeypatch, tmp_path):
    monkeypatch.setenv('MPCC_CACHE_DIR', str(tmp_path / 'a cache'))
    monkeypatch.setenv('CC', 'gcc -pipe')
    assert twice(compile_twice(), 4.0) == 8.0


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


def garble_the_checksum(library):
    library.with_suffix('.sha256').write_bytes(b'\xff' * 64)


@pytest.mark.parametrize('damage', [truncate, flip, empty, lose_the_checksum, garble_the_checksum])
def test_a_damaged_library_is_compiled_again_with_one_line_or_refused(damage, caplog, monkeypatch):
    damage(compile_twice())
    with monkeypatch.context() as no_compiler:
        no_compiler.setenv('CC', 'no-such-compiler')
        with pytest.raises(CompileError, match=r'twice-\S*\.so is damaged.*MPCC_CACHE_DIR'):
            compile_twice()
    library = [compile_twice() for _ in range(2)][1]
    assert twice(library, 21.0) == 42.0
    assert caplog.messages == [f'{library} is damaged: it is compiled again']


def test_without_a_compiler_what_any_compiler_has_built_is_loaded(cache, monkeypatch):
    library = compile_twice()
    older = library.with_name(f'{library.stem[:-8]}00000000.so')
    older.write_bytes(b'damaged')
    monkeypatch.setenv('CC', 'no-such-compiler')
    assert compile_twice() == library
    with pytest.raises(CompileError) as caught:
        compile_twice(flags=('-O1',))
    assert str(caught.value) == (
        f'no C compiler for twice, and no library of it is in {cache}: '
        "install one (Debian, Ubuntu: apt install gcc), let $CC name one (it is 'no-such-compiler')"
        ', or let MPCC_CACHE_DIR name a folder in which a machine of this kind has built the '
        'libraries'
    )


@pytest.mark.parametrize(
    ('value', 'message'),
    [
        ('   ', r"no C compiler for twice.*\$CC .*'   '"),
        ('gcc "', r"no C compiler for twice.*\$CC .*'gcc \"'"),
        ('false', r'false \(\$CC.*refuses --version:\nexit code 1'),
        ('{folder}/not-a-program', r'not-a-program \(\$CC.*refuses --version:\n.*Exec format'),
        ('true', r'true \(\$CC.*refuses twice-\S*:\nexit code 0, no output'),
        ('{folder}/slow', r'slow \(\$CC.*refuses twice-\S*:\n.*timed out'),
    ],
)
def test_a_compiler_that_does_not_work_is_refused_by_name(value, message, tmp_path, monkeypatch):
    slow = '#!/bin/sh\ntest "$1" = --version || exec sleep 60\n'
    for name, content in {'slow': slow, 'not-a-program': 'text'}.items():
        (tmp_path / name).write_text(content)
        (tmp_path / name).chmod(0o755)
    monkeypatch.setattr(compile_cache, '_COMPILE_TIMEOUT_S', 1.0)
    monkeypatch.setenv('CC', value.format(folder=tmp_path))
    with pytest.raises(CompileError, match=f'(?s){message}'):
        compile_twice()


def test_a_folder_that_cannot_be_written_serves_what_it_has_and_refuses_the_rest(cache):
    """As a user who is not root, whom permissions do not bind."""
    library = compile_twice()
    cache.chmod(0o555)
    program = PROGRAM + PROGRAM.replace("'twice'", "'thrice'")
    command = [*ORDINARY_USER, sys.executable, '-c', program]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    cache.chmod(0o755)
    assert done.stdout == f'{library}\n'
    error = done.stderr.splitlines()[-1]
    assert f'CompileError: compiled code cannot be kept in {cache} ({cache}/thrice-' in error
    assert 'Permission denied); let MPCC_CACHE_DIR name a folder' in error


def test_a_folder_that_cannot_be_made_is_refused_by_name(cache):
    cache.write_text('a file')
    with pytest.raises(CompileError, match=f'kept in {cache} .*MPCC_CACHE_DIR'):
        compile_twice()


def test_machine_code_computes_what_the_interpreter_computes(cache):
    case = slalom()
    dynamics = case.problem.dynamics
    for _ in range(2):
        (compiled,) = compile_functions({dynamics.name(): dynamics}, 'slalom_dynamics').values()
    assert len(list(cache.glob('*.so'))) == 1
    assert compiled.class_name() != dynamics.class_name()
    call, names = BufferedFunction(compiled), dynamics.name_in()
    arguments = dict(zip(names, (case.guess.X[7], np.array([0.3, -0.2]), case.P[7])))
    changed = {names[0]: case.guess.X[9]}  # a call keeps what it is not given
    for given, state in ((arguments, case.guess.X[7]), (changed, case.guess.X[9])):
        (result,) = call(**given).values()
        expected = dynamics(state, *list(arguments.values())[1:]).full().ravel()
        assert np.allclose(result, expected, rtol=1e-14, atol=1e-14)
