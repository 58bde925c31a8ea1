"""Find the program of a node as `ros2 run` does."""

import os
import sys
from pathlib import Path


def resolve(package: str, executable: str) -> list[str]:
    """Return the command of a node, found as `ros2 run` does: lib/<package>/<executable>.

    Looks under every prefix of AMENT_PREFIX_PATH and under that of this Python. In a source tree
    that is not installed it is the module <package>.<executable> of this Python.
    """
    prefixes = [p for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    for prefix in (*prefixes, sys.prefix):
        program = Path(prefix, 'lib', package, executable)
        if os.access(program, os.X_OK):
            return [str(program)]
    return [sys.executable, '-m', f'{package}.{executable}']
