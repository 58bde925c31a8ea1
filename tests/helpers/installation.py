"""Installations made for a test: environments that hold what requirements.txt names."""

import importlib.metadata as metadata
import os
import shutil
import subprocess
import sys
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
PACKAGES = (
    'msgs_yaml',
    'node_runtime',
    'stage_solver',
    'scenario_publisher',
    'mpcc_controller',
    'vehicle_plant',
    'bags',
    'experiments',
)
# what a sourced installation, or the bootstrap of the ROS wheels in this process, leaves behind
INHERITED = (
    *('PYTHONPATH', 'PYTHONHOME', 'LD_LIBRARY_PATH', 'AMENT_PREFIX_PATH', 'COLCON_PREFIX_PATH'),
    *('CMAKE_PREFIX_PATH', 'VIRTUAL_ENV', 'ROS_DOMAIN_ID', '_ROS_WHEELS_BOOTSTRAP_COMPLETE'),
)


def said_by(command, **options):
    """Run a command that is to succeed; return what it says."""
    options = {'env': environment(), 'timeout': 600} | options
    done = subprocess.run(
        [str(word) for word in command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        text=True,
        **options,
    )
    assert done.returncode == 0, done.stdout
    return done.stdout


def environment(**more):
    """Return the environment of somebody who has sourced nothing."""
    return {k: v for k, v in os.environ.items() if k not in INHERITED} | more


def third_party(folder):
    """Make a virtual environment of what requirements.txt names; return its interpreter.

    The files are those that the package manager put into this environment.
    """
    said_by([sys.executable, '-m', 'venv', '--without-pip', folder])
    below = Path(sys.prefix)
    for line in (ROOT / 'requirements.txt').read_text().splitlines():
        wanted = Requirement(line)
        if wanted.marker and not wanted.marker.evaluate():
            continue
        found = metadata.distribution(wanted.name)
        assert wanted.specifier.contains(found.version), line
        for file in found.files:
            old = Path(os.path.normpath(found.locate_file(file)))
            new = folder / old.relative_to(below)
            if new.parent == folder / 'bin' or not old.exists():
                continue  # its first line names the interpreter of this environment
            new.parent.mkdir(parents=True, exist_ok=True)
            try:
                os.link(old, new)
            except FileExistsError:
                continue
            except OSError:  # another file system
                shutil.copy2(old, new)
    return folder / 'bin/python'
