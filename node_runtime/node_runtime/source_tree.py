"""Whether the installed packages are those of the source tree that a person edits.

Packages that are installed as wheels are copies: an edit of their source has no effect until they
are installed again, unless they run from their source (`make setup`).
"""

import filecmp
import json
import os
from collections.abc import Iterator
from importlib import metadata, util
from pathlib import Path
from urllib.parse import unquote, urlsplit

from msgs_yaml import share
from node_runtime.provenance import PACKAGES

DATA = ('config', 'scenarios', 'launch')  # folders of a package that go to its share/
CODE = ('.py', '.c', '.h', '.yaml')
SHOWN = 2  # files that the text names


def describe_stale(here: Path) -> str:
    """Return one line about edited source that is not what runs, '' without any.

    The source is the tree that a package was installed from, and the tree around the folder `here`.
    """
    trees = {tree: stale for tree in _trees(here) if (stale := stale_files(tree))}
    lines = []
    for tree, files in trees.items():
        shown = ', '.join(str(file.relative_to(tree)) for file in files[:SHOWN])
        more = f' and {len(files) - SHOWN} more' if len(files) > SHOWN else ''
        lines.append(
            f'edits in {tree} have no effect: {shown}{more}; what runs is installed in '
            f'{os.path.dirname(_installed_in())}. `make setup` there makes every edit count'
        )
    return '; '.join(lines)


def stale_files(tree: Path) -> list[Path]:
    """Return the files of a source tree that are newer than their installed copies and differ."""
    return [
        source
        for package in PACKAGES
        for source, copy in _pairs(tree, package)
        if _is_newer(source, copy)
    ]


def _trees(here):
    """Yield the source trees, each once."""
    folders = [_origin(package) for package in PACKAGES]
    folders += [folder for folder in (here, *here.parents) if _is_tree(folder)][:1]
    return dict.fromkeys(tree.resolve() for tree in folders if tree and _is_tree(tree))


def _is_tree(folder):
    return (folder / 'node_runtime' / 'package.xml').is_file() and (folder / 'Makefile').is_file()


def _origin(package) -> Path | None:
    """Return the folder above the one that pip copied a package from, None where it did not."""
    try:
        record = json.loads(metadata.distribution(package).read_text('direct_url.json') or '{}')
    except (metadata.PackageNotFoundError, ValueError):
        return None
    url = urlsplit(record.get('url', ''))
    if url.scheme != 'file' or 'dir_info' not in record or record['dir_info'].get('editable'):
        return None
    return Path(unquote(url.path)).parent


def _installed_in():
    return os.path.dirname(util.find_spec('node_runtime').origin)


def _pairs(tree, package) -> Iterator[tuple[Path, Path]]:
    """Yield each source file with the path of its installed copy."""
    spec = util.find_spec(package)
    if spec is None or spec.origin is None:
        return
    installed, source = Path(spec.origin).resolve().parent, tree / package
    if installed == (source / package).resolve():
        return  # what runs is the source
    for file in _files(source / package):
        yield file, installed / file.relative_to(source / package)
    for folder in DATA:
        try:
            shared = share.path(package, folder)
        except FileNotFoundError:
            continue
        for file in _files(source / folder):
            yield file, shared / file.relative_to(source / folder)


def _files(folder):
    for root, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if name != '__pycache__']
        yield from (Path(root, name) for name in names if name.endswith(CODE))


def _is_newer(source, copy):
    """Return whether a file was edited after it was copied, or never copied."""
    try:
        copied_s = copy.stat().st_mtime
    except OSError:
        return True
    return source.stat().st_mtime > copied_s and not filecmp.cmp(source, copy, shallow=False)
