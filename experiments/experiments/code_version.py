"""The version of the code that decides a run: a digest of sources, libraries and processor."""

import ast
import hashlib
import json
from collections.abc import Mapping
from functools import cache
from importlib import util
from pathlib import Path

from node_runtime import provenance

# simulates and evaluates a run; its imports, and theirs, decide the result, too
ROOTS = ('experiments.drive_row',)
LIBRARIES = ('casadi', 'numpy', 'commonroad-vehicle-models')
TEMPLATES = ('stage_solver', ('.c', '.h'))  # of the generated solver; not imported


@cache
def digest(roots: tuple[str, ...] = ROOTS) -> str:
    """Return the SHA-256 of sources, libraries and processor, which decides the solver's times.

    `roots` are modules; what they import counts, too.
    """
    versions, machine = provenance.versions(), provenance.machine()
    kept = [versions[name] for name in LIBRARIES] + [machine['processor']]
    return hashlib.sha256((digest_sources(roots) + json.dumps(kept)).encode()).hexdigest()


def digest_sources(roots: tuple[str, ...] = ROOTS) -> str:
    """Return the SHA-256 of the sources of `roots`, and of all that they import."""
    digest_ = hashlib.sha256()
    for name, path in sorted({**modules(roots), **_templates()}.items()):
        digest_.update(f'{name}\0'.encode() + path.read_bytes() + b'\0')
    return digest_.hexdigest()


@cache
def describe(roots: tuple[str, ...] = ROOTS) -> Mapping[str, str]:
    """Return what decides results, by name, so that two machines can be compared."""
    versions, machine = provenance.versions(), provenance.machine()
    return {
        'sources': digest_sources(roots)[:12],
        **{name: versions[name] for name in ('python', *LIBRARIES, 'scipy')},
        'processor': machine['processor'],
        'libc': machine['libc'],
    }


def modules(roots: tuple[str, ...] = ROOTS) -> dict[str, Path]:
    """Return {name: file} of `roots` and of all modules of this project that they import."""
    files, pending = {}, list(roots)
    while pending:
        name = pending.pop()
        path = _file(name)
        if name in files or path is None:
            continue
        files[name] = path
        pending += _imported(ast.parse(path.read_text()))
        if '.' in name:  # its package is imported first
            pending.append(name.rpartition('.')[0])
    return files


def _imported(node):
    """Yield what a module imports, but for what only a type checker reads."""
    if isinstance(node, ast.If) and getattr(node.test, 'id', '') == 'TYPE_CHECKING':
        return
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom) and node.level == 0:
        yield node.module
        yield from (f'{node.module}.{alias.name}' for alias in node.names)
    for inner in ast.iter_child_nodes(node):
        yield from _imported(inner)


def _file(name):
    """Return the file of a module of this project, None for any other name."""
    package, *below = name.split('.')
    if package not in provenance.PACKAGES:
        return None
    base = _folder(package).joinpath(*below)
    return next(filter(Path.is_file, (base.with_suffix('.py'), base / '__init__.py')), None)


@cache
def _folder(package):
    return Path(util.find_spec(package).origin).parent


def _templates():
    package, suffixes = TEMPLATES
    folder = _folder(package)
    return {
        str(path.relative_to(folder.parent)): path
        for path in folder.rglob('*')
        if path.suffix in suffixes
    }
