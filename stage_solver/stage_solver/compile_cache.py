"""Compile C source to a shared library once per machine, in a cache that processes share.

A file of the cache is called NAME-CODE-COMPILER.so. CODE covers what the library is to do: source,
flags, and the CPU when the flags contain -march=native; COMPILER is the version that made it. With
a compiler its own library counts; without one that of any compiler does, so a machine that has none
drives with what was built ahead. Beside each library is its checksum: nothing damaged is loaded.
"""

import fcntl
import hashlib
import logging
import os
import platform
import shlex
import shutil
import subprocess
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path

_COMPILE_TIMEOUT_S = 900.0
_MAX_LINES = 12
_LOG = logging.getLogger(__name__)  # without a handler a warning is a line on stderr


class CompileError(OSError):
    """There is no library of a source, and none can be made; the text says why."""


def compile_library(c_source: str, name: str, flags: tuple[str, ...]) -> Path:
    """Return the shared library of a C source, from the cache or compiled now.

    `name` is the prefix of the file name, `flags` follow -shared -fPIC; the compiler is $CC, else
    gcc, else cc. A damaged library is compiled again, with a line in the log. Raises CompileError
    when the compiler fails, is missing, or may not write into the folder of the cache.
    """
    compiler, folder = find_compiler(), cache_dir()
    native = [_cpu()] if '-march=native' in flags else []
    code = f'{name}-{_digest(chr(0).join([c_source, *flags, *native]))[:32]}'
    if compiler is None:
        return _built_ahead(folder, code, name)
    library = folder / f'{code}-{_digest(_version(compiler))[:8]}.so'
    if _is_whole(library):
        return library
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with open(library.with_suffix('.lock'), 'w') as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            # another process may have finished while this one waited
            if not _is_whole(library):
                if library.exists():
                    _LOG.warning('%s is damaged: it is compiled again', library)
                _compile(c_source, library, compiler, flags)
    except CompileError:
        raise
    except OSError as error:
        reason = f'{error.filename or folder}: {error.strerror}'
        raise CompileError(
            f'compiled code cannot be kept in {folder} ({reason}); '
            'let MPCC_CACHE_DIR name a folder that can be written'
        ) from None
    return library


def cache_dir() -> Path:
    """Return $MPCC_CACHE_DIR, else mpcc in $XDG_CACHE_HOME, else ~/.cache/mpcc."""
    if os.environ.get('MPCC_CACHE_DIR'):
        return Path(os.environ['MPCC_CACHE_DIR'])
    base = os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache'
    return Path(base) / 'mpcc'


def find_compiler() -> str | None:
    """Return the command of the C compiler, or None."""
    configured = os.environ.get('CC')
    for command in [configured] if configured else ['gcc', 'cc']:
        with suppress(ValueError, IndexError):  # a quote without its end, blanks alone
            if shutil.which(shlex.split(command)[0]):
                return command
    return None


def _built_ahead(folder, code, name):
    """Return the newest whole library of a code, by any compiler."""
    libraries = sorted(folder.glob(f'{code}-*.so'), key=os.path.getmtime, reverse=True)
    for library in libraries:
        if _is_whole(library):
            return library
    lack = f'{libraries[0]} is damaged' if libraries else f'no library of it is in {folder}'
    raise CompileError(
        f'no C compiler for {name}, and {lack}: install one (Debian, Ubuntu: apt install gcc), '
        f'let $CC name one (it is {os.environ.get("CC", "")!r}), or let MPCC_CACHE_DIR name a '
        'folder in which a machine of this kind has built the libraries'
    )


def _is_whole(library):
    """Return whether a library is there, and as it was when it was compiled."""
    try:
        return library.with_suffix('.sha256').read_bytes() == _digest(library.read_bytes()).encode()
    except OSError:
        return False


def _digest(content):
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()


@cache
def _version(compiler):
    return _run(compiler, ['--version'], 60.0)


def _run(compiler, arguments, timeout_s, library=None):
    """Return what the compiler prints, and make the library, if any. Raises CompileError."""
    command = [*shlex.split(compiler), *arguments]
    try:
        done = subprocess.run(command, capture_output=True, errors='replace', timeout=timeout_s)
        if not done.returncode and (library is None or library.exists()):
            return done.stdout
        reason = done.stderr or f'exit code {done.returncode}, no output'
    except (OSError, subprocess.TimeoutExpired) as error:
        reason = str(error)
    what = library.stem if library else '--version'
    head = '\n'.join(reason.splitlines()[:_MAX_LINES])
    raise CompileError(f'{compiler} ($CC, else gcc, else cc) refuses {what}:\n{head}')


def _cpu():
    """Return model and instruction sets of the CPU, or platform.processor() without /proc."""
    info = Path('/proc/cpuinfo')
    if not info.exists():
        return platform.processor() or platform.machine()
    first = info.read_text().split('\n\n')[0].splitlines()
    keys = ('vendor_id', 'cpu family', 'model', 'stepping', 'flags', 'CPU ', 'Features')
    return '\n'.join(line for line in first if line.startswith(keys))


def _compile(c_source, library, compiler, flags):
    with tempfile.TemporaryDirectory(dir=library.parent, prefix='.build-') as folder:
        source = Path(folder, 'source.c')
        source.write_text(c_source)
        built = Path(folder, library.name)
        arguments = ['-shared', '-fPIC', *flags, '-o', str(built), str(source), '-lm']
        _run(compiler, arguments, _COMPILE_TIMEOUT_S, built)
        checksum = Path(folder, 'checksum')
        checksum.write_text(_digest(built.read_bytes()))
        # renames are atomic, and who sees one without the other waits for the lock
        os.replace(checksum, library.with_suffix('.sha256'))
        os.replace(built, library)
