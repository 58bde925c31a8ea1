"""The environment of processes that have tf2_msgs, built where it is not installed."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

VIEWERS = Path(__file__).parents[1] / 'bags' / 'viewers'
LISTENER = VIEWERS / 'tf_listener.py'
BUILD_S = 120


def environment(folder: Path) -> dict[str, str]:
    """Return the environment; a build goes into the folder."""
    result = dict(os.environ)
    if importlib.util.find_spec('tf2_msgs'):
        return result
    build = [sys.executable, VIEWERS / 'tf2_build.py', folder]
    subprocess.run(build, check=True, timeout=BUILD_S, stdout=subprocess.DEVNULL)
    for name in ('LD_LIBRARY_PATH', 'PYTHONPATH', 'AMENT_PREFIX_PATH'):
        result[name] = os.pathsep.join(filter(None, (result.get(name), str(folder))))
    return result
