"""Find the files of a package: data in its share directory, programs as `ros2 run` does."""

import importlib.util
import os
import sys
from pathlib import Path


def path(package: str, *relative: str) -> Path:
    """Return the path of a data file of a package.

    Searched in this order: the source tree, when the package is imported from one; every entry of
    AMENT_PREFIX_PATH (a ROS installation or a colcon workspace); the prefix of this Python (a
    virtual environment). Raises FileNotFoundError that names every path tried.
    """
    roots = _source_tree(package) + [Path(prefix, 'share', package) for prefix in _prefixes()]
    tried = [root.joinpath(*relative) for root in roots]
    for candidate in tried:
        if os.path.exists(candidate):  # false of a name that is too long, too
            return candidate
    paths = '\n  '.join(map(str, tried))
    raise FileNotFoundError(f'{"/".join(relative)} of package {package} is in none of\n  {paths}')


def node_command(package: str, executable: str) -> list[str]:
    """Return the command line of a node, found as `ros2 run` does: lib/<package>/<executable>.

    Searched under every prefix of AMENT_PREFIX_PATH and under that of this Python. In a source tree
    that is not installed it is the module <package>.<executable>, run by this Python.
    """
    for prefix in _prefixes():
        program = Path(prefix, 'lib', package, executable)
        if os.access(program, os.X_OK):
            return [str(program)]
    return [sys.executable, '-m', f'{package}.{executable}']


def _prefixes():
    ament = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    return [*filter(None, ament), sys.prefix]


def _source_tree(package):
    """Return the folder that holds package.xml beside the imported module, [] without one."""
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        return []
    folder = Path(spec.origin).resolve().parent.parent
    return [folder] if (folder / 'package.xml').is_file() else []
