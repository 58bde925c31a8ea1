"""Compile C source to a shared library once per machine, in a cache that processes share.

The cache key covers everything that determines the machine code: source, compiler version, flags,
and the CPU when the flags contain -march=native.
"""

import fcntl
import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import tempfile
import warnings
from functools import cache
from pathlib import Path

_COMPILE_TIMEOUT_S = 900.0
_MAX_LINES = 12


class CompileError(RuntimeError):
    """The C compiler failed; the text has the first lines of its output."""


class NoCompilerWarning(RuntimeWarning):
    """There is no C compiler; slower interpreted code runs instead."""


def compile_library(c_source: str, name: str, flags: tuple[str, ...]) -> Path | None:
    """Return the shared library of a C source, from the cache or compiled now.

    `name` is the prefix of the file name, `flags` follow -shared -fPIC. Returns None when the
    machine has no C compiler ($CC, else gcc, else cc). Raises CompileError when it fails.
    """
    compiler = find_compiler()
    if compiler is None:
        return None
    digest = _key(c_source, compiler, flags)
    folder = cache_dir()
    folder.mkdir(parents=True, exist_ok=True)
    library = folder / f'{name}-{digest}.so'
    if library.exists():
        return library
    with open(folder / f'{name}-{digest}.lock', 'w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        # another process may have finished while this one waited
        if not library.exists():
            _compile(c_source, library, compiler, flags)
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


@cache
def warn_no_compiler(consequence: str) -> None:
    """Warn with NoCompilerWarning, once per process and consequence."""
    warnings.warn(f'no C compiler found: {consequence}', NoCompilerWarning, stacklevel=2)


def _key(c_source, compiler, flags):
    parts = [c_source, _version(compiler), *flags]
    if '-march=native' in flags:
        parts.append(_cpu())
    text = '\0'.join(parts)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


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
        # rename is atomic: readers see no library or a complete one
        os.replace(built, library)
