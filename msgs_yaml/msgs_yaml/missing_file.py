"""What a message says of a file or folder that does not exist: what is there in its place."""

import difflib
import os
from collections.abc import Callable, Iterable
from pathlib import Path

YAML_SUFFIXES = ('.yaml', '.yml')
LISTED = 12  # names, before the rest is counted


def describe_neighbours(wanted: str | Path, what: str, is_kept: Callable[[Path], bool]) -> str:
    """Return what is in the folder in which `wanted` is not, with the closest name of it.

    what      the kind of the files, as 'YAML file'
    is_kept   whether a file or folder is of this kind

    As in 'scenarios holds bend.yaml, straight.yaml; did you mean 'scenarios/bend.yaml'?'.
    """
    wanted = Path(wanted)
    # not Path.expanduser, which raises for an unknown user
    folder = Path(os.path.expanduser(wanted)).parent
    shown = 'this folder' if str(wanted.parent) == '.' else str(wanted.parent)
    if not os.path.isdir(folder):  # also where its name is too long for one
        return f'there is no folder {shown}'
    try:
        names = sorted(path.name for path in folder.iterdir() if is_kept(path))
    except OSError as error:
        return f'{shown}: {error.strerror}'
    if not names:
        return f'there is no {what} in {shown}'
    # compared by their names alone: all paths of a folder begin alike
    match = difflib.get_close_matches(wanted.name, names, n=1)
    hint = f'; did you mean {os.path.normpath(wanted.parent / match[0])!r}?' if match else ''
    return f'{shown} holds {list_names(names)}{hint}'


def is_yaml(path: Path) -> bool:
    """Return whether a path is that of a YAML file."""
    return path.suffix in YAML_SUFFIXES and path.is_file()


def describe_yaml_here(name: str) -> str:
    """Return how to give the YAML file that `name` is without suffix, '' if there is none."""
    for suffix in YAML_SUFFIXES:
        if name and os.path.isfile(name + suffix):
            return f'there is a file {name}{suffix} in this folder: give its path, ./{name}{suffix}'
    return ''


def list_names(names: Iterable[str]) -> str:
    """Return names as a list of at most LISTED, and how many there are besides."""
    names = list(names)
    more = f' and {len(names) - LISTED} more' if len(names) > LISTED else ''
    return ', '.join(names[:LISTED]) + more
