"""Provenance of a run for the metadata of its bag: parameters, versions, machine, commit."""

import contextlib
import hashlib
import json
import os
import platform
import subprocess
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from msgs_yaml import share

VERSIONS = {
    'casadi': 'casadi',
    'commonroad-vehicle-models': 'commonroad-vehicle-models',
    'fastdds': 'ros-fastrtps',
    'mcap': 'mcap',
    'numpy': 'numpy',
    'rclpy': 'rclpy',
    'rmw_fastrtps': 'ros-rmw-fastrtps-cpp',
    'scipy': 'scipy',
}
PACKAGES = (
    'bags',
    'experiments',
    'mpcc_controller',
    'msgs_yaml',
    'node_runtime',
    'scenario_publisher',
    'state_estimator',
    'stage_solver',
    'vehicle_plant',
)
# tracked files that commands of this project write
RESULTS = ('paper', 'README.md', 'docs', 'bags/reference')
UNKNOWN = 'unknown'
LABEL = 'label'  # name in the metadata of a run that its user labelled
CONTROLLER_TEXT = 'controller_description'  # the comment at the top of the parameter file
LABEL_SIGN = '@'  # between controller and label, or number, in the name of a run
DIRTY = '-dirty'
GIT_S = 5.0


def describe_run(
    scenario: str, text: str, controller: str, mode: str, parameters: Mapping[str, Mapping]
) -> dict[str, str]:
    """Return the metadata of a run, each a text; structured values are JSON.

    `text` is the scenario file; `parameters` are those of every node by role and dotted name.
    """
    return {
        'scenario': scenario,
        'scenario_text': text,
        'scenario_sha256': digest(text),
        'controller': controller,
        'parameters': json.dumps(parameters, sort_keys=True),
        **describe_environment(mode),
    }


def describe_environment(mode: str) -> dict[str, str]:
    """Return the metadata of any recording, also of nodes that were started by hand."""
    return {
        'mode': mode,
        'versions': json.dumps(versions(), sort_keys=True),
        'machine': json.dumps(machine(), sort_keys=True),
        'git_commit': commit(),
    }


def run_name(run_info: Mapping[str, str]) -> str:
    """Return the name of a recorded run: its controller, with its label where it has one.

    Raises KeyError without a controller.
    """
    label = run_info.get(LABEL)
    return LABEL_SIGN.join([run_info['controller'], *([label] if label else [])])


def digest(text: str) -> str:
    """Return the SHA-256 of a text as hex digits."""
    return hashlib.sha256(text.encode()).hexdigest()


def digest_file(path: Path) -> str:
    """Return the SHA-256 of a file as hex digits; raises OSError."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def versions() -> dict[str, str]:
    """Return the version of everything that may change the numbers of a run."""
    known = {'python': platform.python_version()} | dict.fromkeys((*VERSIONS, *PACKAGES), UNKNOWN)
    for name, distribution in VERSIONS.items():
        with contextlib.suppress(metadata.PackageNotFoundError):
            known[name] = metadata.version(distribution)
    for package in PACKAGES:
        with contextlib.suppress(FileNotFoundError):
            manifest = ElementTree.parse(share.path(package, 'package.xml'))
            known[package] = manifest.findtext('version', UNKNOWN)
    return known


def machine() -> dict[str, Any]:
    """Return the description of this machine."""
    lines = Path('/proc/cpuinfo').read_text().splitlines()
    models = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return {
        'processor': models[0] if models else platform.processor(),
        'architecture': platform.machine(),
        'cores': len(os.sched_getaffinity(0)),
        'kernel': platform.release().partition('-')[0],  # the rest names its builder
        'libc': ' '.join(platform.libc_ver()),
    }


def commit() -> str:
    """Return the commit of the working tree of this file, '' outside of one.

    DIRTY is appended if a tracked file has changed, except for RESULTS, which the measuring
    commands themselves change.
    """
    here = Path(__file__).parent
    root = _git(here, 'rev-parse', '--show-toplevel')
    # an installation may be inside another repository
    if not root or not Path(root, 'bags', 'package.xml').is_file():
        return ''
    head = _git(here, 'rev-parse', 'HEAD')
    excluded = [f':(top,exclude){folder}' for folder in RESULTS]
    changed = _git(here, 'status', '--porcelain', '--untracked-files=no', '--', ':(top)', *excluded)
    if not head or changed is None:
        return ''
    return head + (DIRTY if changed else '')


def _git(folder, *arguments):
    try:
        result = subprocess.run(
            ['git', '-C', folder, *arguments], capture_output=True, text=True, timeout=GIT_S
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return result.stdout.strip() if result.returncode == 0 else None


def leading_comment(text: str) -> str:
    """Return the comment at the top of a YAML file, without the `#`, as one paragraph."""
    lines = []
    for line in text.splitlines():
        if not line.startswith('#'):
            break
        lines.append(line.lstrip('#').strip())
    return ' '.join(line for line in lines if line)
