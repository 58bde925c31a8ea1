"""The MCAP files that make up a bag: one, or several numbered ones when it was split."""

import re
from pathlib import Path

from bags.errors import BagError

NUMBERED = re.compile(r'(?P<name>.*)_(?P<number>\d+)\.mcap')


def mcap_files(path: Path | str) -> list[Path]:
    """Return the files of a bag in the order of their numbers; `path` itself where it is a file.

    Raises BagError when there are none, or those of several bags.
    """
    path = Path(path)
    if not path.is_dir():
        if not path.exists():
            raise BagError(f'{path}: there is no such bag')
        return [path]
    found = sorted(path.glob('*.mcap'))
    if len(found) == 1:
        return found
    parts = [NUMBERED.fullmatch(file.name) for file in found]
    if not all(parts) or len({part['name'] for part in parts}) != 1:
        names = ', '.join(file.name for file in found) or 'none'
        raise BagError(
            f'{path}: not a bag: it must hold one file *.mcap, or the numbered ones of one bag; '
            f'it holds {names}'
        )
    return sorted(found, key=_number)


def missing_before(file: Path, before: Path) -> str | None:
    """Return the name of the first file that is missing between two of a split bag, or None."""
    wanted = _number(before) + 1
    if _number(file) == wanted:
        return None
    return f'{NUMBERED.fullmatch(file.name)["name"]}_{wanted}.mcap'


def _number(file):
    return int(NUMBERED.fullmatch(file.name)['number'])
