"""Virtual environments for tests, with the packages of a file of requirements."""

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
    'state_estimator',
    'mpcc_controller',
    'vehicle_plant',
    'bags',
    'experiments',
)
# variables set by a sourced installation or by the bootstrap of the ROS wheels in this process
INHERITED = (
    *('PYTHONPATH', 'PYTHONHOME', 'LD_LIBRARY_PATH', 'AMENT_PREFIX_PATH', 'COLCON_PREFIX_PATH'),
    *('CMAKE_PREFIX_PATH', 'VIRTUAL_ENV', 'ROS_DOMAIN_ID', '_ROS_WHEELS_BOOTSTRAP_COMPLETE'),
)


def run_checked(command, **options):
    """Run a command that must succeed; return its output."""
    options = {'env': environment(), 'timeout': 600} | options
    result = subprocess.run(
        [str(word) for word in command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        text=True,
        **options,
    )
    assert result.returncode == 0, result.stdout
    return result.stdout


def environment(**more):
    """Return the environment of a shell that has sourced nothing."""
    return {k: v for k, v in os.environ.items() if k not in INHERITED} | more


def make_environment(folder, requirements='requirements.txt'):
    """Make a virtual environment with the packages of a file; return its interpreter.

    Links or copies the installed files of this environment.
    """
    run_checked([sys.executable, '-m', 'venv', '--without-pip', folder])
    below = Path(sys.prefix)
    for line in (ROOT / requirements).read_text().splitlines():
        requirement = Requirement(line)
        if requirement.marker and not requirement.marker.evaluate():
            continue
        distribution = metadata.distribution(requirement.name)
        assert requirement.specifier.contains(distribution.version), line
        for file in distribution.files:
            old = Path(os.path.normpath(distribution.locate_file(file)))
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
