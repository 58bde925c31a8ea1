"""Find the data files of a package: in its source tree, or where an installation put them."""

import importlib.util
import os
import sys
from pathlib import Path


def path(package: str, *relative: str) -> Path:
    """Return the path of a data file of a package.

    Searched in this order: the source tree, when the package is imported from one; every entry of
    AMENT_PREFIX_PATH (a ROS installation or a colcon workspace); the prefix of this Python (a
    virtual environment). Raises FileNotFoundError that names every place tried.
    """
    tried = [root.joinpath(*relative) for root in _roots(package)]
    for candidate in tried:
        if candidate.exists():
            return candidate
    places = '\n  '.join(map(str, tried))
    raise FileNotFoundError(f'{"/".join(relative)} of package {package} is in none of\n  {places}')


def _roots(package):
    source = _source_tree(package)
    prefixes = [p for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    installed = [Path(prefix, 'share', package) for prefix in [*prefixes, sys.prefix]]
    return [source, *installed] if source else installed


def _source_tree(package):
    """Return the folder that holds package.xml beside the imported module, or None."""
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        return None
    folder = Path(spec.origin).resolve().parent.parent
    return folder if (folder / 'package.xml').is_file() else None
