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
from functools import cache
from pathlib import Path

_COMPILE_TIMEOUT_S = 900.0
_MAX_LINES = 12
_LOG = logging.getLogger(__name__)  # without a handler a warning is a line on stderr
AHEAD = (
    'install one (Debian, Ubuntu: apt install gcc), or let MPCC_CACHE_DIR name a folder '
    'in which a machine of this kind has built the libraries'
)


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
    raise CompileError(f'no C compiler for {name}, and {lack}: {AHEAD}')


def _is_whole(library):
    """Return whether a library is there, and as it was when it was compiled."""
    try:
        return library.with_suffix('.sha256').read_text() == _digest(library.read_bytes())
    except OSError:
        return False


def _digest(content):
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()


@cache
def _version(compiler):
    command = [*shlex.split(compiler), '--version']
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout


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
        command = [*shlex.split(compiler), '-shared', '-fPIC', *flags, '-o', str(built)]
        command += [str(source), '-lm']
        result = subprocess.run(command, capture_output=True, text=True, timeout=_COMPILE_TIMEOUT_S)
        if result.returncode:
            head = '\n'.join(result.stderr.splitlines()[:_MAX_LINES])
            raise CompileError(f'{compiler} refuses {library.stem}:\n{head}')
        checksum = Path(folder, 'checksum')
        checksum.write_text(_digest(built.read_bytes()))
        # renames are atomic, and who sees one without the other waits for the lock
        os.replace(checksum, library.with_suffix('.sha256'))
        os.replace(built, library)
