"""The version of the code that decides a drive: a digest of sources, libraries and processor."""

import ast
import hashlib
import json
from functools import cache
from importlib import util
from pathlib import Path

from node_runtime import provenance

# what drives and judges; whatever they import, and what that imports, decides a drive, too
ROOTS = ('experiments.study.case', 'experiments.study.measure')
TEMPLATES = ('stage_solver', ('.c', '.h'))  # of the generated solver; nothing imports them


@cache
def digest() -> str:
    """Return the SHA-256 of all of it; times of the solver belong to the machine, too."""
    found = hashlib.sha256()
    for name, path in sorted({**modules(), **_templates()}.items()):
        found.update(f'{name}\0'.encode() + path.read_bytes() + b'\0')
    versions, machine = provenance.versions(), provenance.machine()
    kept = [versions[name] for name in ('casadi', 'numpy')] + [machine['processor']]
    found.update(json.dumps(kept).encode())
    return found.hexdigest()


def modules() -> dict[str, Path]:
    """Return the files of ROOTS and of all modules of this project that they need, by name."""
    found, to_do = {}, list(ROOTS)
    while to_do:
        name = to_do.pop()
        path = _file(name)
        if name in found or path is None:
            continue
        found[name] = path
        to_do += _imported(path)
        if '.' in name:  # its package is imported first
            to_do.append(name.rpartition('.')[0])
    return found


def _imported(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.module
            yield from (f'{node.module}.{alias.name}' for alias in node.names)


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
